"""Takes out of messages what means nothing: bytes between their fields and behind the last one.

rclpy hands over buffers as the middleware sized them. What stands in the gaps is whatever was in
memory, and some bytes follow the last field; `rosbags` refuses messages with more than three of
those. No value is changed.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import Layout
from tombo_bag.columns import grouped_by_shape
from tombo_bag.schemas import Types


def without_padding(typename: str, messages: Sequence[bytes], types: Types) -> list[bytes]:
    """Return messages of a type, gaps zero and nothing behind the last field, in the same order.

    A message that is not little-endian CDR of this type is returned as it is.
    """
    cleaned = list(messages)
    for group in grouped_by_shape(typename, cleaned, types, lost=[]):
        meant = _meant(group.layout)
        end = int(np.flatnonzero(meant)[-1]) + 1
        block = np.where(meant[:end], group.block[:, :end], np.uint8(0))
        whole: Any = np.ascontiguousarray(block).view(f"V{end}").ravel().tolist()
        for row, message in zip(group.rows.tolist(), whole, strict=True):
            cleaned[row] = message
    return cleaned


def _meant(layout: Layout) -> NDArray[np.bool_]:
    """Return which bytes of a message mean something."""
    meant = np.zeros(len(layout.template), bool)
    meant[layout.fixed] = True
    for leaf in layout.leaves:
        number = 1 if leaf.count is None else leaf.count
        meant[leaf.offset : leaf.offset + leaf.dtype.itemsize * number] = True
    for text in layout.texts:
        (size,) = struct.unpack_from("<I", layout.template, text.offset - 4)  # with closing zero
        meant[text.offset : text.offset + size] = True
    return meant

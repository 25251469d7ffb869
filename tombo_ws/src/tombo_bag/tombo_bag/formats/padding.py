"""Takes out of messages what means nothing: bytes between their fields and behind the last one.

rclpy hands over buffers as the middleware sized them. What stands in the gaps is whatever was in
memory, and some bytes follow the last field; `rosbags` refuses messages with more than three of
those. No value is changed.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import Layout, layout_of
from tombo_bag.schemas import Types
from tombo_dynamics.errors import InputError


class _Shape:
    """A layout, its end (behind the last field), and the places before that mean nothing."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        meant = np.zeros(len(layout.template), bool)
        meant[layout.fixed] = True
        for leaf in layout.leaves:
            number = 1 if leaf.count is None else leaf.count
            meant[leaf.offset : leaf.offset + leaf.dtype.itemsize * number] = True
        for text in layout.texts:
            (size,) = struct.unpack_from("<I", layout.template, text.offset - 4)
            meant[text.offset : text.offset + size] = True
        self.end = int(np.flatnonzero(meant)[-1]) + 1
        self.gaps = np.flatnonzero(~meant[: self.end])


class PaddingNormalizer:
    """Cleans the messages of one type, many at once. Remembers the shapes it has seen."""

    def __init__(self, typename: str, types: Types) -> None:
        self._typename = typename
        self._types = types
        self._shapes: dict[int, _Shape] = {}

    def clean(self, messages: Sequence[bytes]) -> list[bytes]:
        """Return the messages, gaps zero and nothing behind the last field, in the same order.

        A message that is not little-endian CDR of this type is returned as it is.
        """
        cleaned = list(messages)
        rows_of: dict[int, list[int]] = {}
        for row, message in enumerate(cleaned):
            rows_of.setdefault(len(message), []).append(row)
        for size, rows in rows_of.items():
            self._clean_equal(cleaned, np.array(rows), size)
        return cleaned

    def _clean_equal(self, messages: list[bytes], rows: NDArray[np.intp], size: int) -> None:
        """Clean messages of one size in place."""
        joined = bytearray().join([messages[row] for row in rows])
        block: NDArray[np.uint8] = np.frombuffer(joined, np.uint8).reshape(len(rows), size)
        shape = self._shapes.get(size)
        while len(rows):
            fits = None if shape is None else shape.layout.same_shape(block)
            if shape is None or fits is None or not fits.any():
                try:
                    layout = layout_of(self._typename, messages[rows[0]], self._types)
                except InputError:
                    rows, block = rows[1:], block[1:]
                    continue
                shape = self._shapes[size] = _Shape(layout)
                fits = layout.same_shape(block)
            done = block[fits]
            done[:, shape.gaps] = 0
            whole = np.ascontiguousarray(done[:, : shape.end]).view(f"V{shape.end}").ravel()
            for row, message in zip(rows[fits].tolist(), whole.tolist(), strict=True):
                messages[row] = message
            rows, block = rows[~fits], block[~fits]

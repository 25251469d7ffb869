"""Takes out of messages what means nothing: bytes between their fields and behind the last one.

rclpy hands over buffers as the middleware sized them. What stands in the gaps is whatever was in
memory, and some bytes follow the last field; `rosbags` refuses messages with more than three of
those. No value is changed.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import Layout, layout_of
from tombo_bag.schemas import Types
from tombo_dynamics.errors import InputError


@dataclass(frozen=True)
class _Shape:
    """Where messages of one size and shape mean something.

    Attributes:
        fixed: places of encapsulation, lengths and counts, which make the shape.
        values: what stands there.
        gaps: places before the end that mean nothing.
        end: first byte behind the last field.
    """

    fixed: NDArray[np.intp]
    values: NDArray[np.uint8]
    gaps: NDArray[np.intp]
    end: int

    @classmethod
    def of(cls, layout: Layout) -> _Shape:
        message = np.frombuffer(layout.template, np.uint8)
        fixed = (np.arange(4)[None, :] + np.array([0, *layout.counts])[:, None]).ravel()
        meant = np.zeros(len(message), bool)
        meant[fixed] = True
        for leaf in layout.leaves:
            number = 1 if leaf.count is None else leaf.count
            meant[leaf.offset : leaf.offset + leaf.dtype.itemsize * number] = True
        for text in layout.texts:
            (size,) = struct.unpack_from("<I", layout.template, text.offset - 4)
            meant[text.offset : text.offset + size] = True
        end = int(np.flatnonzero(meant)[-1]) + 1
        return cls(fixed, message[fixed], np.flatnonzero(~meant[:end]), end)


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
            fits = np.zeros(len(rows), bool)
            if shape is not None:
                fits = (block[:, shape.fixed] == shape.values).all(axis=1)
            if shape is None or not fits.any():
                try:
                    layout = layout_of(self._typename, messages[rows[0]], self._types)
                except InputError:
                    rows, block = rows[1:], block[1:]
                    continue
                shape = self._shapes[size] = _Shape.of(layout)
                fits = (block[:, shape.fixed] == shape.values).all(axis=1)
            done = block[fits]
            done[:, shape.gaps] = 0
            whole = np.ascontiguousarray(done[:, : shape.end]).view(f"V{shape.end}").ravel()
            for row, message in zip(rows[fits].tolist(), whole.tolist(), strict=True):
                messages[row] = message
            rows, block = rows[~fits], block[~fits]

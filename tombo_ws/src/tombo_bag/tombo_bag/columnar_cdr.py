"""Messages as bytes (CDR), one at a time or a whole column of them at once.

ROS 2 sends and records a message in CDR, XCDR version 1, little endian: four bytes that say so,
then the fields in order. A number of k bytes starts at a multiple of k, counted after those four
bytes; a string is its length with the closing zero, then its bytes; a sequence is its count, then
its elements. (OMG DDS-XTypes 1.3, section 7.4.1.)

If strings keep their text and sequences their count, each message of a type has the same bytes at
the same places but for its numbers. So a *layout* is worked out once from one template message,
and the numbers of N messages are then laid in as N-element columns.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from tombo_bag.schemas import Types, known_types
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.time_base import SECOND_NS

ENCAPSULATION = b"\x00\x01\x00\x00"
"""What every message starts with: CDR, little endian, no options."""

NUMBERS: dict[str, np.dtype[Any]] = {
    "bool": np.dtype("?"),
    "byte": np.dtype("u1"),
    "char": np.dtype("u1"),
    "int8": np.dtype("i1"),
    "uint8": np.dtype("u1"),
    "int16": np.dtype("<i2"),
    "uint16": np.dtype("<u2"),
    "int32": np.dtype("<i4"),
    "uint32": np.dtype("<u4"),
    "int64": np.dtype("<i8"),
    "uint64": np.dtype("<u8"),
    "float32": np.dtype("<f4"),
    "float64": np.dtype("<f8"),
}

EMPTY_MEMBER = ("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))
"""What stands in a message without fields, such as std_msgs/Empty."""


@dataclass(frozen=True)
class Leaf:
    """One number, or one run of equal numbers, in a message.

    Attributes:
        path: where it stands, as in `pose.position.x` or `transforms[0].header.stamp.sec`.
        dtype: numpy type of one number.
        count: None for a single number, else the length of the array or sequence.
        offset: bytes from the message's first byte.
    """

    path: str
    dtype: np.dtype[Any]
    count: int | None
    offset: int


@dataclass(frozen=True)
class TextPlace:
    """One string in a message: `size` bytes of UTF-8 from `offset`, closing zero not counted."""

    path: str
    offset: int
    size: int


@dataclass(frozen=True)
class Layout:
    """Where everything stands in the messages of one type that share one shape.

    Attributes:
        typename: message type.
        template: a message of this shape.
        leaves: the numbers, in order.
        texts: the strings, in order.
        counts: offsets of the 4-byte lengths of strings and sequences, which make the shape.
    """

    typename: str
    template: bytes
    leaves: tuple[Leaf, ...]
    texts: tuple[TextPlace, ...]
    counts: tuple[int, ...]

    @cached_property
    def fixed(self) -> NDArray[np.intp]:
        """Places of the encapsulation, lengths and counts, which make the shape."""
        places = np.arange(4)[None, :] + np.array([0, *self.counts])[:, None]
        return np.asarray(places.ravel())

    def same_shape(self, block: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Tell which of (N, size) messages of the template's size have its shape."""
        template = np.frombuffer(self.template, np.uint8)
        return np.asarray((block[:, self.fixed] == template[self.fixed]).all(axis=1))

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """Numpy structured type of a whole message: one named field per leaf, none overlapping."""
        filled = [leaf for leaf in self.leaves if leaf.count != 0]
        return np.dtype(
            {
                "names": [leaf.path for leaf in filled],
                "formats": [
                    leaf.dtype if leaf.count is None else (leaf.dtype, (leaf.count,))
                    for leaf in filled
                ],
                "offsets": [leaf.offset for leaf in filled],
                "itemsize": len(self.template),
            }
        )

    def records(self, number: int) -> NDArray[np.void]:
        """Return `number` copies of the template as a writable structured array.

        Assign columns by path, `records["pose.position.x"] = x`; the array's bytes are then the
        messages, one after the other. A slice is fine, but not a copy: numpy copies the named
        fields alone, not the strings and counts between them.
        """
        return np.frombuffer(bytearray(self.template * number), dtype=self.dtype)


def encode(typename: str, values: Mapping[str, Any], types: Types | None = None) -> bytes:
    """Write one message.

    Args:
        typename: message type.
        values: fields by name; nested messages as mappings, arrays and sequences as sequences.
            A field left out is zero, empty or, for a nested message, default throughout.
        types: definitions to use instead of the known ones.

    Raises:
        InputError: unknown type or field, or an array of the wrong length.
    """
    known = known_types() if types is None else types
    writer = _Writer(known)
    writer.message(typename, values, "")
    return bytes(writer.buffer)


def lay_in(records: NDArray[np.void], path: str, values: NDArray[Any]) -> None:
    """Lay a column into the field at a path, or a vector's into the fields x, y, z, w below it.

    Args:
        records: (N,) of `Layout.records`.
        path: of a number or an array of numbers, or of a message with x, y, z (and w).
        values: (N,) or (N, k).
    """
    if path in (records.dtype.names or ()):
        records[path] = values
        return
    for i, axis in enumerate("xyzw"[: values.shape[1]]):
        records[f"{path}.{axis}"] = values[:, i]


def lay_in_times(records: NDArray[np.void], path: str, times_ns: NDArray[np.int64]) -> None:
    """Lay (N,) times [ns] into the builtin_interfaces/Time at a path."""
    records[f"{path}.sec"], records[f"{path}.nanosec"] = np.divmod(times_ns, SECOND_NS)


def layout(typename: str, template: Mapping[str, Any], types: Types | None = None) -> Layout:
    """Work out the layout of the messages that look like a template (see `encode`)."""
    known = known_types() if types is None else types
    return layout_of(typename, encode(typename, template, known), known)


def layout_of(typename: str, message: bytes, types: Types) -> Layout:
    """Work out the layout of the messages with the same shape as one at hand.

    Raises:
        InputError: the bytes are no message of this type.
    """
    if message[:4] != ENCAPSULATION:
        header = message[:4].hex(" ")
        raise InputError(
            f"message of {typename} starts with {header}; accepted: 00 01 00 00 (CDR)"
        )
    reader = _Reader(types, message)
    try:
        reader.message(typename, "")
    except struct.error as error:
        size = len(message)
        raise InputError(f"message of {typename} ends too early, after {size} bytes") from error
    return Layout(
        typename, message, tuple(reader.leaves), tuple(reader.texts), tuple(reader.counts)
    )


class _Writer:
    """Walks a type's definition and appends the values given for it."""

    def __init__(self, types: Types) -> None:
        self.types = types
        self.buffer = bytearray(ENCAPSULATION)

    def message(self, typename: str, values: Mapping[str, Any], path: str) -> None:
        fields = _fields(self.types, typename)
        unknown = set(values) - {name for name, _ in fields}
        if unknown:
            raise unknown_name(
                f"field of {typename}", path + min(unknown), [name for name, _ in fields]
            )
        for name, (kind, content) in fields:
            self.field(kind, content, values.get(name), path + name)

    def field(self, kind: int, content: Any, value: Any, path: str) -> None:
        if kind == Nodetype.BASE:
            self.base(content[0], value)
        elif kind == Nodetype.NAME:
            self.message(content, {} if value is None else value, path + ".")
        else:
            element, size = content
            fixed = kind == Nodetype.ARRAY
            items = _items(value, size if fixed else 0, path)
            if fixed and len(items) != size:
                raise InputError(f"{path} has {len(items)} elements; accepted: {size}")
            if not fixed:
                self.length(len(items))
            self.elements(element, items, path)

    def elements(self, element: tuple[int, Any], items: Any, path: str) -> None:
        kind, content = element
        if kind == Nodetype.BASE and content[0] != "string":
            dtype = number_type(content[0])
            if len(items):
                self.align(dtype.itemsize)
                numbers = np.zeros(len(items)) if items[0] is None else np.asarray(items)
                self.buffer += numbers.astype(dtype).tobytes()
        else:
            for i, item in enumerate(items):
                self.field(kind, content, item, f"{path}[{i}]")

    def base(self, name: str, value: Any) -> None:
        if name == "string":
            text = ("" if value is None else str(value)).encode() + b"\0"
            self.length(len(text))
            self.buffer += text
        else:
            dtype = number_type(name)
            self.align(dtype.itemsize)
            self.buffer += np.asarray(0 if value is None else value, dtype).tobytes()

    def length(self, value: int) -> None:
        self.align(4)
        self.buffer += struct.pack("<I", value)

    def align(self, size: int) -> None:
        self.buffer += bytes(-(len(self.buffer) - 4) % size)


class _Reader:
    """Walks a type's definition along a message and notes where everything stands."""

    def __init__(self, types: Types, message: bytes) -> None:
        self.types = types
        self.bytes = message
        self.position = 4
        self.leaves: list[Leaf] = []
        self.texts: list[TextPlace] = []
        self.counts: list[int] = []

    def message(self, typename: str, path: str) -> None:
        for name, (kind, content) in _fields(self.types, typename):
            self.field(kind, content, path + name)

    def field(self, kind: int, content: Any, path: str) -> None:
        if kind == Nodetype.BASE:
            self.base(content[0], path)
        elif kind == Nodetype.NAME:
            self.message(content, path + ".")
        else:
            element, size = content
            self.elements(element, size if kind == Nodetype.ARRAY else self.length(), path)

    def elements(self, element: tuple[int, Any], number: int, path: str) -> None:
        kind, content = element
        if kind == Nodetype.BASE and content[0] != "string":
            self.numbers(number_type(content[0]), number, path)
            return
        if number > len(self.bytes) - self.position:  # each takes a byte at least
            raise struct.error
        for i in range(number):
            self.field(kind, content, f"{path}[{i}]")

    def base(self, name: str, path: str) -> None:
        if name != "string":
            self.numbers(number_type(name), None, path)
            return
        size = self.length()
        self.texts.append(TextPlace(path, self.position, max(size - 1, 0)))
        self.skip(size)

    def numbers(self, dtype: np.dtype[Any], count: int | None, path: str) -> None:
        if count != 0:
            self.align(dtype.itemsize)
        self.leaves.append(Leaf(path, dtype, count, self.position))
        self.skip(dtype.itemsize * (1 if count is None else count))

    def length(self) -> int:
        self.align(4)
        self.counts.append(self.position)
        (length,) = struct.unpack_from("<I", self.bytes, self.position)
        self.position += 4
        return int(length)

    def skip(self, size: int) -> None:
        self.position += size
        if self.position > len(self.bytes):
            raise struct.error

    def align(self, size: int) -> None:
        self.position += -(self.position - 4) % size


def number_type(name: str) -> np.dtype[Any]:
    """Return the numpy type of a ROS number type; strings and wide types are none."""
    if name not in NUMBERS:
        raise unknown_name("number type", name, NUMBERS)
    return NUMBERS[name]


def _fields(types: Types, typename: str) -> list[tuple[str, Any]]:
    if typename not in types:
        raise unknown_name("message type", typename, types)
    return types[typename][1] or [EMPTY_MEMBER]


def _items(value: Any, size: int, path: str) -> Sequence[Any]:
    if value is None:
        return [None] * size
    if isinstance(value, (str, Mapping)) or not hasattr(value, "__len__"):
        raise InputError(f"{path} is {shown(value)}; accepted: a sequence")
    items: Sequence[Any] = value
    return items

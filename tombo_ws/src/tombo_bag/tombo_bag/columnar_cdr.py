"""Messages as bytes (CDR), one at a time or a whole column of them at once.

ROS 2 sends and records a message in CDR, XCDR version 1, little endian: four bytes that say so,
then the fields in order. A number of k bytes starts at a multiple of k, counted after those four
bytes; a string is its length with the closing zero, then its bytes; a sequence is its count, then
its elements. (OMG DDS-XTypes 1.3, section 7.4.1.)

If strings keep their length and sequences their count, all messages of a type have the same
offsets. A *layout* is computed once, from one template message. Numbers of N messages are then
written as N-element columns. `rosbags` writes the template.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from tombo_bag.schemas import Types, known_types, type_store
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.time_base import SECOND_NS

ENCAPSULATION = b"\x00\x01\x00\x00"
"""First bytes of each message: CDR, little endian, no options."""

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
"""The field of messages without fields, such as std_msgs/Empty."""


@dataclass(frozen=True)
class Leaf:
    """One number, one run of equal numbers, or one string in a message.

    Attributes:
        path: its name, as in `pose.position.x` or `transforms[0].header.stamp.sec`.
        dtype: numpy type of one number; of a string, of kind V, its bytes without closing zero.
        count: None for a single number or a string, else the length of the array or sequence.
        offset: bytes from the message's first byte.
    """

    path: str
    dtype: np.dtype[Any]
    count: int | None
    offset: int

    @property
    def is_text(self) -> bool:
        """Whether it is a string."""
        return self.dtype.kind == "V"


@dataclass(frozen=True)
class Layout:
    """Offsets of all fields in the messages of one type and one shape.

    Attributes:
        typename: message type.
        template: a message of this shape.
        leaves: numbers and strings, in order.
        counts: offsets of the 4-byte lengths of strings and sequences, which define the shape.
    """

    typename: str
    template: bytes
    leaves: tuple[Leaf, ...]
    counts: tuple[int, ...]

    def same_shape(self, block: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Tell which of (N, size) messages of the template's size have its shape.

        The encapsulation, lengths and counts define it.
        """
        fixed = (np.arange(4)[None, :] + np.array([0, *self.counts])[:, None]).ravel()
        template = np.frombuffer(self.template, np.uint8)
        return np.asarray((block[:, fixed] == template[fixed]).all(axis=1))

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """Numpy structured type of a whole message: one named field per leaf, none overlapping."""
        filled = [leaf for leaf in self.leaves if leaf.count != 0 and leaf.dtype.itemsize]
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
        fields alone, not the counts between them.
        """
        return np.frombuffer(bytearray(self.template * number), self.dtype)


def encode(typename: str, values: Mapping[str, Any]) -> bytes:
    """Write one message.

    Args:
        typename: message type.
        values: fields by name; nested messages as mappings, arrays and sequences as sequences.
            A field left out is zero, empty or, for a nested message, default throughout.

    Raises:
        InputError: unknown type or field, or an array of the wrong length.
    """
    return bytes(type_store().serialize_cdr(_message(typename, values, ""), typename))


def lay_in(records: NDArray[np.void], path: str, values: Any) -> None:
    """Write a column into the field at a path, or a vector's into the fields x, y, z, w below it.

    Args:
        records: (N,) of `Layout.records`.
        path: of a number or an array of numbers, or of a message with x, y, z (and w).
        values: (N,) or (N, k); without N: the same in all messages.
    """
    if path in (records.dtype.names or ()):
        records[path] = values
        return
    for axis, column in zip("xyzw", np.asarray(values).T, strict=False):
        records[f"{path}.{axis}"] = column


def lay_in_times(records: NDArray[np.void], path: str, times_ns: Any) -> None:
    """Write times [ns], (N,) or one for all, into the builtin_interfaces/Time at a path."""
    records[f"{path}.sec"], records[f"{path}.nanosec"] = divmod(times_ns, SECOND_NS)


def layout(typename: str, template: Mapping[str, Any]) -> Layout:
    """Work out the layout of the messages that look like a template (see `encode`)."""
    return layout_of(typename, encode(typename, template), known_types())


def layout_of(typename: str, message: bytes, types: Types) -> Layout:
    """Work out the layout of the messages with the same shape as one at hand.

    Raises:
        InputError: the bytes do not fit this type.
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
    return Layout(typename, message, tuple(reader.leaves), tuple(reader.counts))


def _message(typename: str, values: Mapping[str, Any], path: str) -> Any:
    """Return a message as an object of `rosbags`."""
    fields = dict(_fields(known_types(), typename))
    unknown = values.keys() - fields
    if unknown:
        raise unknown_name(f"field of {typename}", path + min(unknown), fields)
    given = {name: _field(of, values.get(name), path + name) for name, of in fields.items()}
    return type_store().types[typename](**given)


def _field(descriptor: tuple[int, Any], value: Any, path: str) -> Any:
    """Return the value of a field as `rosbags` has it."""
    kind, content = descriptor
    if kind == Nodetype.NAME:
        return _message(content, value or {}, f"{path}.")
    if kind == Nodetype.BASE:
        if content[0] == "string":
            return str(value or "")
        return number_type(content[0]).type(0 if value is None else value)
    element, size = content
    fixed = kind == Nodetype.ARRAY
    items = (None,) * size * fixed if value is None else value
    if fixed and len(items) != size:
        raise InputError(f"{path} has {len(items)} elements; accepted: {size}")
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        dtype = number_type(element[1][0])
        return np.zeros(len(items), dtype) if value is None else np.asarray(items, dtype)
    return [_field(element, item, f"{path}[{i}]") for i, item in enumerate(items)]


class _Reader:
    """Walks a type's definition along a message and notes the offset of each field."""

    def __init__(self, types: Types, message: bytes) -> None:
        self.types = types
        self.bytes = message
        self.position = 4
        self.leaves: list[Leaf] = []
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
        size, begin = self.length(), self.position
        self.skip(size)
        self.leaves.append(Leaf(path, np.dtype(("V", max(size - 1, 0))), None, begin))

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

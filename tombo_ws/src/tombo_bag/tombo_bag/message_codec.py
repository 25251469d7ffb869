"""Bytes of messages (CDR) ⇄ the dataclasses of `tombo_dynamics.messages`.

The place of a field follows from its name and its metadata. All messages of a topic have one shape
as long as their texts keep their lengths: a numpy type with the fields of the dataclass reads and
writes them, one in some microseconds, or a column of them at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from tombo_bag.columnar_cdr import Layout, layout, layout_of
from tombo_bag.columns import ColumnTable, TopicColumns
from tombo_bag.schemas import known_types
from tombo_bag.topics import BATTERY, POSE_TYPES, TF
from tombo_dynamics import messages
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_BODY, FRAME_MAP, FRAME_ODOM
from tombo_dynamics.time_base import SECOND_NS

_Kind = TypeVar("_Kind")
_SHAPES = 8
"""Largest number of kept shapes of a type."""
_TIME = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
_UNKNOWN = ("temperature", "charge", "capacity", "design_capacity", "percentage")
CONSTANTS: Mapping[str, Mapping[str, Any]] = {
    TF.typename: {
        "transforms": [
            {
                "header": {"frame_id": FRAME_MAP},
                "child_frame_id": FRAME_ODOM,
                "transform": {"rotation": {"w": 1.0}},  # the estimate does not drift
            },
            {"header": {"frame_id": FRAME_ODOM}, "child_frame_id": FRAME_BODY},
        ]
    },
    BATTERY.typename: {
        "header": {"frame_id": FRAME_BODY},
        "present": True,
        "power_supply_status": 2,  # discharging
        "power_supply_technology": 3,  # lithium polymer
        **dict.fromkeys(_UNKNOWN, float("nan")),
    },
}
"""Of the suite's types without a dataclass: the constant fields of a message."""


@dataclass(frozen=True)
class _Part:
    """The place of one field of a dataclass in the message.

    Attributes:
        name: of the field.
        path: of its first number, of its string, or of its time.
        count: numbers of an array; 1: a single number; 0: a string or a time.
    """

    name: str
    path: str
    count: int = 1

    @property
    def is_time(self) -> bool:
        """Whether it is a time [ns]."""
        return self.count == 0 and self.path.endswith("stamp")

    @property
    def is_text(self) -> bool:
        """Whether it is a string."""
        return self.count == 0 and not self.is_time


_FRAME_ID = "header.frame_id"
_HEADER = {"stamp_ns": "header.stamp", "frame_id": _FRAME_ID}
FORMS: Mapping[str, Any] = {
    messages.typename_of(kind): kind for kind in (*messages.STANDARD_MESSAGES, *messages.MESSAGES)
}
"""Type name → dataclass of its messages."""


def dataclass_of(typename: str) -> Any:
    """Return the dataclass of a type's messages.

    Raises:
        InputError: no core takes or gives this type.
    """
    if typename not in FORMS:
        raise InputError(f"{typename}: no core uses it; accepted: {', '.join(FORMS)}")
    return FORMS[typename]


def _constants(kind: Any) -> dict[str, Any]:
    """Return path → value, of the fields of a message that its dataclass does not have."""
    frame = {_FRAME_ID: kind.frame} if hasattr(kind, "frame") else {}
    return {**frame, **getattr(kind, "fixed", {})}


def _frames(kind: Any) -> dict[str, str]:
    """Return path → frame that messages must have; a status says nothing in a frame."""
    if kind.__name__.endswith("Status"):
        return {}
    return {path: v for path, v in _constants(kind).items() if isinstance(v, str)}


@cache
def _parts(typename: str) -> tuple[_Part, ...]:
    """Return a part for each field of a type's dataclass, in their order."""
    paths = {
        field.name: field.metadata.get("path")
        or _HEADER.get(field.name, field.name.removesuffix("_ns"))
        for field in fields(dataclass_of(typename))
    }
    return tuple(_part(typename, name, path) for name, path in paths.items())


def _part(typename: str, name: str, path: str) -> _Part:
    """Look up a path in the definition of a message."""
    types, inside = known_types(), typename
    for step in path.split("."):
        kind, inside = dict(types[inside][1])[step]
    if kind == Nodetype.ARRAY:
        return _Part(name, path, int(inside[1]))
    if kind == Nodetype.BASE:
        return _Part(name, path, 0 if inside[0] == "string" else 1)
    if inside == "builtin_interfaces/msg/Time":
        return _Part(name, path, 0)
    return _Part(name, f"{path}.x", len(types[inside][1]))


def _array_type(dtype: np.dtype[Any], count: int) -> np.dtype[Any]:
    return np.dtype((dtype, (count,))) if count > 1 else dtype


class _Shape:
    """Messages of a type with the same lengths of texts, by the fields of the dataclass."""

    def __init__(self, typename: str, shape: Layout) -> None:
        self._kind, self._parts = dataclass_of(typename), _parts(typename)
        leaves = {leaf.path: leaf for leaf in shape.leaves}
        at = [leaves[f"{part.path}.sec" if part.is_time else part.path] for part in self._parts]
        types = [
            _TIME if part.is_time else _array_type(leaf.dtype, part.count)
            for part, leaf in zip(self._parts, at, strict=True)
        ]
        self._dtype = np.dtype(
            {
                "names": [part.name for part in self._parts],
                "formats": types,
                "offsets": [leaf.offset for leaf in at],
                "itemsize": len(shape.template),
            }
        )
        self._template = shape.template
        self.frames: dict[str, str] = {}
        """Path → frame in the messages, where it must be that of the dataclass."""
        self._marks = [(at, shape.template[at : at + 4]) for at in (0, *shape.counts)]
        for path in _frames(self._kind):
            begin, size = leaves[path].offset, leaves[path].dtype.itemsize
            self._marks.append((begin, shape.template[begin : begin + size]))
            self.frames[path] = self._marks[-1][1].decode("utf-8", "replace")

    def fits(self, data: bytes) -> bool:
        """Return whether bytes have this shape: the same lengths and frames."""
        return len(data) >= len(self._template) and all(
            data.startswith(mark, at) for at, mark in self._marks
        )

    def read(self, data: bytes) -> Any:
        record, values = np.frombuffer(data, self._dtype, 1)[0], list[Any]()
        for part in self._parts:
            value = record[part.name]
            if part.is_time:
                seconds, nanoseconds = value.item()
                values.append(seconds * SECOND_NS + nanoseconds)
            elif part.is_text:
                values.append(value.item().decode("utf-8", "replace"))
            else:
                values.append(value.astype(np.float64) if part.count > 1 else value.item())
        return self._kind(*values)

    def write(self, columns: Mapping[str, Any], number: int = 1) -> NDArray[np.void]:
        """Return N messages; a field is (N,) or (N, k), or lacks N where it is the same in all."""
        records = np.frombuffer(bytearray(self._template * number), self._dtype)
        for part in self._parts:
            if part.is_text or part.name not in columns:
                continue
            field, values = records[part.name], columns[part.name]
            if part.is_time:
                field["sec"], field["nanosec"] = divmod(values, SECOND_NS)
            else:
                field[...] = values
        return records


class MessageCodec:
    """Reads and writes the messages of one type."""

    def __init__(self, typename: str) -> None:
        """Look up the dataclass of the type's messages.

        Raises:
            InputError: no core takes or gives this type.
        """
        self.typename = typename
        self._frames = _frames(dataclass_of(typename))
        self._names = [field.name for field in fields(dataclass_of(typename))]
        self._times = [part.name for part in _parts(typename) if part.is_time]
        self._texts = {part.path: part.name for part in _parts(typename) if part.is_text}
        self._read: list[_Shape] = []
        self._written: dict[tuple[str, ...], _Shape] = {}

    def decode(self, data: bytes) -> Any:
        """Return the dataclass of a message.

        Raises:
            InputError: the bytes do not fit this type, or are of another frame.
        """
        for shape in self._read:
            if shape.fits(data):
                return shape.read(data)
        shape = _Shape(self.typename, layout_of(self.typename, data, known_types()))
        for path, text in shape.frames.items():
            if text.lstrip("/") != self._frames[path]:
                raise InputError(f"{path} is '{text}'; accepted: '{self._frames[path]}'")
        self._read = [shape, *self._read[: _SHAPES - 1]]
        return shape.read(data)

    def encode(self, message: Any) -> bytes:
        """Return a dataclass as a message."""
        values = {name: getattr(message, name) for name in self._names}
        values |= {name: max(values[name], 0) for name in self._times}
        texts = tuple(values[name] for name in self._texts.values())
        shape = self._written.get(texts)
        if shape is None:
            if len(self._written) >= _SHAPES:
                self._written.clear()
            shape = self._written[texts] = _shape_with(
                self.typename, dict(zip(self._texts, texts, strict=True))
            )
        return shape.write(values).tobytes()


def fields_of(typename: str, table: ColumnTable) -> TopicColumns:
    """Return a recorded topic, read as columns, by field of its messages.

    Names are those of the dataclass where the type has one, else those of the definition. Fields
    x, y, z (and w) are one column (N, 3) or (N, 4); a time is one of nanoseconds.
    """
    form = FORMS.get(typename)
    known = () if form is None else fields(form)
    names = {field.metadata["path"]: field.name for field in known if "path" in field.metadata}
    names |= dict(zip(POSE_TYPES.get(typename, ()), ("position", "attitude"), strict=False))
    columns = TopicColumns(getattr(table, "topic", typename), {}, names)
    for path, column in table.items():
        outer, _, last = path.rpartition(".")
        axes = _axes(outer, table) if last in tuple("xyzw") else ""
        if last in ("sec", "nanosec") and {f"{outer}.sec", f"{outer}.nanosec"} <= table.keys():
            seconds = table[f"{outer}.sec"].astype(np.int64)
            name = outer.removeprefix("header.")
            columns[f"{name}_ns"] = seconds * SECOND_NS + table[f"{outer}.nanosec"]
        elif not axes:
            columns[names.get(path, path.removeprefix("header."))] = column
        elif last == "x":
            parts = [table[f"{outer}.{axis}"].astype(np.float64) for axis in axes]
            columns[names.get(outer, outer)] = np.stack(parts, axis=1)
    return columns


def _axes(outer: str, table: ColumnTable) -> str:
    """Return the axes of a vector or a quaternion, xyz or xyzw; empty: it is none."""
    there = (axis for axis in "xyzw" if f"{outer}.{axis}" in table)
    axes = "".join(axis for axis in there if table[f"{outer}.{axis}"].dtype.kind in "fiu")
    return axes if axes in ("xyz", "xyzw") else ""


def messages_of(typename: str, table: ColumnTable) -> list[Any]:
    """Return the messages of a recorded topic, read as columns, as dataclasses."""
    return as_messages(dataclass_of(typename), fields_of(typename, table))


def as_messages(kind: type[_Kind], columns: Mapping[str, NDArray[Any]]) -> list[_Kind]:
    """Return messages as dataclasses, from columns by field.

    A field that has a default may be missing: recordings are older than it.
    """
    given = {
        field.name: _values(columns[field.name])
        for field in fields(kind)  # type: ignore[arg-type]
        if not _has_default(field) or field.name in columns
    }
    rows = zip(*given.values(), strict=True)
    return [kind(**dict(zip(given, values, strict=True))) for values in rows]


def _has_default(field: Any) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING


def encoded(typename: str, columns: Mapping[str, NDArray[Any]]) -> Any:
    """Return messages as bytes, from columns: structured, or a list if they have texts.

    Args:
        typename: of the messages.
        columns: (N,) or (N, k), the fields of the dataclass by name; missing fields are 0.
            A frame that the dataclass holds is map.
    """
    if any(values.dtype.kind == "U" for values in columns.values()):
        codec = MessageCodec(typename)
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        return [
            codec.encode(dataclass_of(typename)(**dict(zip(columns, row, strict=True))))
            for row in rows
        ]
    texts = {part.path: FRAME_MAP for part in _parts(typename) if part.path == _FRAME_ID}
    return _shape_with(typename, texts).write(columns, len(columns["stamp_ns"]))


def _shape_with(typename: str, texts: Mapping[str, str]) -> _Shape:
    """Return the shape of messages with these texts, by their paths."""
    nested: dict[str, Any] = {}
    for path, value in {**_constants(dataclass_of(typename)), **texts}.items():
        outer, _, inner = path.rpartition(".")
        (nested.setdefault(outer, {}) if outer else nested)[inner] = value
    return _Shape(typename, layout(typename, nested))


def _values(column: NDArray[Any]) -> list[Any]:
    """Return the values of a field: numbers and texts of Python, arrays of floats."""
    return column.tolist() if column.ndim == 1 else list(column.astype(np.float64))

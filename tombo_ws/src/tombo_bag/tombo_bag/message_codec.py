"""Bytes of messages (CDR) ⇄ the dataclasses of `tombo_dynamics.messages`.

Where a field stands follows from its name and its metadata. Messages of one shape
(`MessageTemplate`) are read and written in some microseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from tombo_bag.columnar_cdr import lay_in, lay_in_times, layout
from tombo_bag.columns import ColumnTable, TopicColumns
from tombo_bag.message_template import Field, MessageTemplate, TimeField
from tombo_bag.schemas import known_types
from tombo_bag.topics import POSE_TYPES
from tombo_dynamics import messages
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.time_base import SECOND_NS

_Kind = TypeVar("_Kind")
_SHAPES = 8
"""So many shapes of a type are kept."""


@dataclass(frozen=True)
class _Part:
    """Where one field of a dataclass stands in the message.

    Attributes:
        path: of its first number, of its string, or of its time.
        count: numbers of an array; 1: a single number; 0: a string or a time.
    """

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


@dataclass(frozen=True)
class Form:
    """How a dataclass stands in a message."""

    kind: type
    frames: Mapping[str, str]
    """Path → frame; what the dataclass itself holds is not in here."""
    values: Mapping[str, Any]
    """What always stands in the message besides."""
    any_frame: bool
    """Messages of another frame are taken too: a status says nothing in a frame."""


_FRAME_ID = "header.frame_id"
_HEADER = {"stamp_ns": "header.stamp", "frame_id": _FRAME_ID}


def _form(kind: Any) -> Form:
    fixed: dict[str, Any] = dict(getattr(kind, "fixed", {}))
    frames = {_FRAME_ID: kind.frame} if hasattr(kind, "frame") else {}
    frames |= {path: value for path, value in fixed.items() if isinstance(value, str)}
    values = {path: value for path, value in fixed.items() if path not in frames}
    return Form(kind, frames, values, kind.__name__.endswith("Status"))


FORMS = {
    messages.typename_of(kind): _form(kind)
    for kind in (*messages.STANDARD_MESSAGES, *messages.MESSAGES)
}
"""Type name → how its dataclass stands in it."""


@cache
def form_of(typename: str) -> Form:
    """Return how a type's dataclass stands in it.

    Raises:
        InputError: no core takes or gives this type.
    """
    if typename not in FORMS:
        raise InputError(f"{typename}: no core uses it; accepted: {', '.join(FORMS)}")
    return FORMS[typename]


@cache
def _parts(typename: str) -> tuple[_Part, ...]:
    """Return a part for each field of a type's dataclass, in their order."""
    paths = {
        field.name: field.metadata.get("path")
        or _HEADER.get(field.name, field.name.removesuffix("_ns"))
        for field in fields(form_of(typename).kind)
    }
    return tuple(_part(typename, path) for path in paths.values())


def _part(typename: str, path: str) -> _Part:
    """Look up in the definition of a message what stands at a path."""
    types, inside = known_types(), typename
    for name in path.split("."):
        kind, inside = dict(types[inside][1])[name]
    if kind == Nodetype.ARRAY:
        return _Part(path, int(inside[1]))
    if kind == Nodetype.BASE:
        return _Part(path, 0 if inside[0] == "string" else 1)
    if inside == "builtin_interfaces/msg/Time":
        return _Part(path, 0)
    return _Part(f"{path}.x", len(types[inside][1]))


class _Shape:
    """One shape of a message, and where the fields of the dataclass stand in it."""

    def __init__(self, typename: str, template: MessageTemplate) -> None:
        self.template = template
        self._kind = form_of(typename).kind
        self._parts = _parts(typename)
        self._places: list[Field | TimeField | str] = []
        for part in self._parts:
            if part.is_time:
                self._places.append(template.time(part.path))
            elif part.is_text:
                self._places.append(template.texts[part.path])
            else:
                self._places.append(template.field(part.path, part.count))

    def read(self, data: bytes) -> Any:
        values: list[Any] = []
        for part, place in zip(self._parts, self._places, strict=True):
            if isinstance(place, Field):
                numbers = place.of(data)
                values.append(numbers[0] if part.count == 1 else np.array(numbers))
            else:
                values.append(place if isinstance(place, str) else place.of(data))
        return self._kind(*values)

    def write(self, values: list[Any]) -> bytes:
        for part, place, value in zip(self._parts, self._places, values, strict=True):
            if isinstance(place, Field):
                place.put((value,) if part.count == 1 else value)
            elif isinstance(place, TimeField):
                place.put(max(value, 0))
        return self.template.data()


class MessageCodec:
    """Reads and writes the messages of one type."""

    def __init__(self, typename: str) -> None:
        """Look up how the type's dataclass stands in it.

        Raises:
            InputError: no core takes or gives this type.
        """
        self.typename = typename
        self._form = form_of(typename)
        self._names = [field.name for field in fields(self._form.kind)]
        self._texts = [(i, part.path) for i, part in enumerate(_parts(typename)) if part.is_text]
        self._read: list[_Shape] = []
        self._written: dict[tuple[str, ...], _Shape] = {}

    def decode(self, data: bytes) -> Any:
        """Return the dataclass of a message.

        Raises:
            InputError: the bytes are no message of this type, or of another frame.
        """
        for shape in self._read:
            if shape.template.fits(data):
                return shape.read(data)
        template = MessageTemplate.of_bytes(self.typename, data)
        frames = {} if self._form.any_frame else self._form.frames
        for path, frame in frames.items():
            text = template.texts[path]
            if text.lstrip("/") != frame:
                raise InputError(f"{path} is '{text}'; accepted: '{frame}'")
        shape = _Shape(self.typename, template)
        self._read = [shape, *self._read[: _SHAPES - 1]]
        return shape.read(data)

    def encode(self, message: Any) -> bytes:
        """Return a dataclass as a message."""
        values = [getattr(message, name) for name in self._names]
        texts = tuple(values[i] for i, _ in self._texts)
        shape = self._written.get(texts)
        if shape is None:
            if len(self._written) >= _SHAPES:
                self._written.clear()
            every = {**self._form.frames}
            every |= {path: text for (_, path), text in zip(self._texts, texts, strict=True)}
            nested = _nested(every, self._form.values)
            shape = _Shape(self.typename, MessageTemplate(self.typename, nested))
            self._written[texts] = shape
        return shape.write(values)


def fields_of(typename: str, table: ColumnTable) -> TopicColumns:
    """Return a recorded topic, read as columns, by field of its messages.

    Names are those of the dataclass where the type has one, else those of the definition. What
    has x, y, z (and w) is one column (N, 3) or (N, 4); a time is one of nanoseconds.
    """
    form = FORMS.get(typename)
    known = () if form is None else fields(form.kind)
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
    return as_messages(form_of(typename).kind, fields_of(typename, table))


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
    """Return messages as bytes, laid in by columns: structured, or a list if they have texts.

    Args:
        typename: of the messages.
        columns: (N,) or (N, k), the fields of the dataclass by name; what is not there is 0.
            A frame that the dataclass holds is map.
    """
    form, count = form_of(typename), len(columns["stamp_ns"])
    if any(values.dtype.kind == "U" for values in columns.values()):
        codec = MessageCodec(typename)
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        return [codec.encode(form.kind(**dict(zip(columns, row, strict=True)))) for row in rows]
    carried = {part.path: FRAME_MAP for part in _parts(typename) if part.path == _FRAME_ID}
    template = _nested({**carried, **form.frames}, form.values)
    records = layout(typename, template).records(count)
    for part, field in zip(_parts(typename), fields(form.kind), strict=True):
        values = columns.get(field.name)
        if part.is_text or values is None:
            continue
        if part.is_time:
            lay_in_times(records, part.path, values)
        else:
            lay_in(records, part.path.removesuffix(".x"), values)
    return records


def _nested(texts: Mapping[str, str], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a template with strings at their paths."""
    nested: dict[str, Any] = dict(values)
    for path, text in texts.items():
        outer, _, inner = path.rpartition(".")
        if outer:
            nested[outer] = {inner: text}
        else:
            nested[inner] = text
    return nested


def _values(column: NDArray[Any]) -> list[Any]:
    """Return the values of a field: numbers and texts of Python, arrays of floats."""
    return column.tolist() if column.ndim == 1 else list(column.astype(np.float64))

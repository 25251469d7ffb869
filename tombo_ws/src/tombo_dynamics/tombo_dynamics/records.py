"""Records: named fields with units, in one piece of memory that compiled code and Python share.

A record is a class of fields. In compiled functions and in Python alike `plant.state.position` is
a view of three numbers, and `plant.mass` one number:

    class Supply(Record):
        charge = field("A h", "charge used")
        voltage = field("V", "at the drives")

    supply = Supply.new()
    supply.voltage = 11.1

A compiled function that returns a record returns a copy: functions take the records they write.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache
from operator import itemgetter
from typing import Any, ClassVar, TypeVar

import numpy as np

from tombo_dynamics.arrays import Array

_Kind = TypeVar("_Kind", bound="Record")
_TYPES = {float: np.float64, int: np.int64, bool: np.bool_}


@dataclass(frozen=True)
class Field:
    """One field of a record."""

    unit: str
    doc: str
    shape: tuple[int, ...]
    kind: Any
    """float, int, bool, a numpy type, a record, or a class of parameters: its numbers."""

    def layout(self) -> Any:
        """Return the numpy type of one element."""
        if isinstance(self.kind, np.dtype):
            return self.kind
        if issubclass(self.kind, Record):
            return self.kind.layout
        if self.kind in _TYPES:
            return np.dtype(_TYPES[self.kind])
        return parameter_kind(self.kind).layout


def field(unit: str, doc: str, shape: int | tuple[int, ...] = (), kind: Any = float) -> Any:
    """Declare a field of a record.

    Args:
        unit: SI unit as text ("1" for none; "" for a record, which has its own).
        doc: what it is; vectors also say their frame.
        shape: length, or shape, of an array; empty: one element.
        kind: see `Field`.
    """
    return Field(unit, doc, (shape,) if isinstance(shape, int) else shape, kind)


def fill_parameters(record: Any, params: Any) -> None:
    """Write the numbers of a parameter record into a field of that class."""
    for name in record.dtype.names:
        record[name] = float(getattr(params, name))


def parameter_record(params: Any) -> Any:
    """Return the numbers of a parameter record as compiled code takes them."""
    record = parameter_kind(params.__class__).new()
    fill_parameters(record, params)
    return record


def numbers(record: Any) -> Array:
    """Return a copy of all numbers of a record that has floats only, as one array (N)."""
    return np.frombuffer(record, np.float64).copy()


def set_numbers(record: Any, values: Array) -> None:
    """Write values (N) into the fields of a record that has floats only, in their order."""
    first = 0
    for name in record.dtype.names:
        shape = record[name].shape
        size = int(np.prod(shape))
        record[name] = np.reshape(values[first : first + size], shape)
        first += size


class Record(np.void):
    """Base of all records; `layout` is its numpy type, `fields` what was declared."""

    fields: ClassVar[dict[str, Field]]
    layout: ClassVar[np.dtype[Any]]
    plain_layout: ClassVar[Any]
    """The same without the classes."""

    def __init_subclass__(cls) -> None:
        cls.fields = {n: f for n, f in vars(cls).items() if isinstance(f, Field)}
        columns = [(name, one.layout(), one.shape) for name, one in cls.fields.items()]
        # a numpy type with a class of its own has lost its alignment: offsets are those without
        plain = [(name, _plain(layout), shape) for name, layout, shape in columns]
        cls.plain_layout = np.dtype(plain, align=True)
        aligned: Any = {
            "names": [name for name, _, _ in columns],
            "formats": [(layout, shape) for _, layout, shape in columns],
            "offsets": [cls.plain_layout.fields[name][1] for name, _, _ in columns],
            "itemsize": cls.plain_layout.itemsize,
        }
        cls.layout = np.dtype((cls, np.dtype(aligned, align=True)))
        for name, one in cls.fields.items():
            setattr(cls, name, property(itemgetter(name), doc=f"{one.doc} [{one.unit}]"))

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a field; raises ValueError for another name."""
        self[name] = value

    @classmethod
    def new(cls: type[_Kind]) -> _Kind:
        """Return a record of zeros."""
        record: _Kind = cls.array()[0]
        return record

    @classmethod
    def array(cls) -> Any:
        """Return an array (1) of a record of zeros.

        To call compiled code with it takes 0.3 us, with a record up to 10 us, more with each
        field: calls from Python at every sample hand over arrays.
        """
        return np.zeros(1, cls.layout)


def _plain(layout: Any) -> Any:
    return layout.type.plain_layout if issubclass(layout.type, Record) else layout


@cache
def parameter_kind(params: Any) -> type[Record]:
    """Return the record that holds the numeric fields of a class of parameters, as floats."""
    named = {one.name: one.metadata for one in dataclasses.fields(params)}
    numeric = {
        n: field(meta["unit"], meta["doc"]) for n, meta in named.items() if "bounds" in meta
    }
    return type(params.__name__, (Record,), numeric)

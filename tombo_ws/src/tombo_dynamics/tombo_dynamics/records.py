"""Records: named fields with units, in one piece of memory that compiled code and Python share.

A record is a class of fields. In compiled functions and in Python alike `plant.state.position` is
a view of three numbers, and `plant.mass` one number:

    class Supply(Record):
        charge = field("A h", "charge used")
        voltage = field("V", "at the drives")

    supply = Supply.new()
    supply.voltage = 11.1
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from typing import Any, ClassVar, TypeVar

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.params import numeric_fields

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

    def layout(self) -> np.dtype[Any]:
        """Return the numpy type of one element."""
        if isinstance(self.kind, np.dtype):
            return self.kind
        if issubclass(self.kind, Record):
            return np.dtype(self.kind.layout)
        if self.kind in _TYPES:
            return np.dtype(_TYPES[self.kind])
        return parameter_layout(self.kind)


def field(unit: str, doc: str, shape: int | tuple[int, ...] = (), kind: Any = float) -> Any:
    """Declare a field of a record.

    Args:
        unit: SI unit as text ("1" for none; "" for a record, which has its own).
        doc: what it is; vectors also say their frame.
        shape: length, or shape, of an array; empty: one element.
        kind: see `Field`.
    """
    return Field(unit, doc, (shape,) if isinstance(shape, int) else shape, kind)


def parameter_layout(params: type[Any]) -> np.dtype[Any]:
    """Return the numpy type that holds the numeric fields of a class of parameters, as floats."""
    return np.dtype([(name, np.float64) for name in numeric_fields(params)])


def fill_parameters(record: Any, params: Any) -> None:
    """Write the numbers of a parameter record into a field of that class."""
    for name in record.dtype.names:
        record[name] = float(getattr(params, name))


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

    def __init_subclass__(cls) -> None:
        cls.fields = {n: f for n, f in vars(cls).items() if isinstance(f, Field)}
        columns = [(name, one.layout(), one.shape) for name, one in cls.fields.items()]
        cls.layout = np.dtype((cls, np.dtype(columns, align=True)))
        for name, one in cls.fields.items():
            setattr(cls, name, property(itemgetter(name), doc=f"{one.doc} [{one.unit}]"))

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a field; raises ValueError for another name."""
        self[name] = value

    @classmethod
    def new(cls: type[_Kind]) -> _Kind:
        """Return a record of zeros."""
        record: _Kind = np.zeros(1, cls.layout)[0]
        return record

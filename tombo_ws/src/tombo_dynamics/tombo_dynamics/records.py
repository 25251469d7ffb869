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

import copy
import dataclasses
from dataclasses import dataclass
from functools import cache
from operator import itemgetter
from typing import Any, ClassVar, TypeVar

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.params import numeric_fields

_Kind = TypeVar("_Kind", bound="Record")
_WORD = 8
_TYPES = {float: np.float64, int: np.int64, bool: np.bool_}


@dataclass(frozen=True)
class RecordField:
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
        kind: type[Record] = parameter_kind(self.kind)
        return kind.layout


def field(unit: str, doc: str, shape: int | tuple[int, ...] = (), kind: Any = float) -> Any:
    """Declare a field of a record.

    Args:
        unit: SI unit as text ("1" for none; "" for a record, which has its own).
        doc: its meaning; of vectors with their frame.
        shape: length, or shape, of an array; empty: one element.
        kind: see `RecordField`.
    """
    return RecordField(unit, doc, (shape,) if isinstance(shape, int) else shape, kind)


def fill_record(record: Any, source: Any) -> None:
    """Write the fields of a dataclass into the record that has their names."""
    for name in record.dtype.names:
        record[name] = getattr(source, name)


def parameter_record(params: Any) -> Any:
    """Return the numbers of a parameter record as compiled code takes them."""
    record = parameter_kind(params.__class__).new()
    fill_record(record, params)
    return record


def numbers(record: Any) -> Array:
    """Return a copy of all numbers of a record that has floats only, as one array (N)."""
    return np.frombuffer(record, np.float64).copy()


class Record(np.void):
    """Base of all records; `layout` is its numpy type, `fields` what was declared."""

    fields: ClassVar[dict[str, RecordField]]
    layout: ClassVar[np.dtype[Any]]

    def __init_subclass__(cls) -> None:
        new_fields = {n: f for n, f in vars(cls).items() if isinstance(f, RecordField)}
        cls.fields = {**getattr(cls, "fields", {}), **new_fields}
        reserved = [name for name in new_fields if hasattr(np.void, name)]
        if reserved:
            raise ValueError(
                f"{cls.__name__}: numpy has its own meaning for {', '.join(reserved)}"
            )
        formats = [
            np.dtype((declared.layout(), declared.shape)) for declared in cls.fields.values()
        ]
        # Whole words: numpy does not know how a record inside a record is to be aligned.
        ends = np.cumsum([-(-part.itemsize // _WORD) * _WORD for part in formats]).tolist()
        placed = {
            "names": list(cls.fields),
            "formats": formats,
            "offsets": [0, *ends[:-1]],
            "itemsize": ends[-1],
        }
        cls.layout = np.dtype((cls, np.dtype(placed, align=True)))  # type: ignore[call-overload]
        for name, declared in new_fields.items():
            setattr(cls, name, property(itemgetter(name), doc=f"{declared.doc} [{declared.unit}]"))

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a field; raises ValueError for another name."""
        self[name] = value

    @classmethod
    def new(cls: type[_Kind]) -> _Kind:
        """Return a record of zeros."""
        record: _Kind = np.zeros(1, cls.layout)[0]
        return record

    def as_array(self) -> Any:
        """Return the array (1) that a record made by `new` is the element of.

        Python hands an array to compiled code in 0.3 us, a record in up to 10 us, more with each
        field: calls at every sample take arrays.
        """
        return self.base

    def __deepcopy__(self, memo: dict[int, Any] | None) -> Any:
        """Copy record and array together: they stay one piece of memory."""
        array = copy.deepcopy(self.base, memo)
        return self.copy() if array is None else array[0]


@cache
def parameter_kind(params: Any) -> type[Record]:
    """Return the record that holds the numeric fields of a class of parameters, as floats."""
    declared = {
        declaration.name: declaration.metadata for declaration in dataclasses.fields(params)
    }
    numeric = {
        name: field(declared[name]["unit"], declared[name]["doc"])
        for name in numeric_fields(params)
    }
    return type(params.__name__, (Record,), numeric)

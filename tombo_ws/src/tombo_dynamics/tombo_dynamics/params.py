"""Parameter records: one frozen dataclass holds value, unit, bounds and meaning of each parameter.

Everything else (reading YAML, checking bounds, documentation, ROS declarations, what compiled code
takes) is derived from the record.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from operator import index
from typing import Any, SupportsIndex, TypeVar

from tombo_dynamics.errors import InputError, shown, unknown_name

SEED_LIMIT = 2**63
_Record = TypeVar("_Record")


def check_seed(name: str, value: object) -> int:
    """Return a checked seed.

    Args:
        name: as the user gave it.
        value: the given one.

    Raises:
        InputError: it is not a whole number, or out of bounds.
    """
    if isinstance(value, SupportsIndex) and not isinstance(value, bool):
        seed = index(value)
        if 0 <= seed < SEED_LIMIT:
            return seed
    raise InputError(
        f"{name} {shown(value)}: out of bounds; accepted: a whole number from 0 to "
        f"{SEED_LIMIT - 1}"
    )


def param(
    default: float | None, unit: str, bounds: tuple[float, float], doc: str, source: str = ""
) -> Any:
    """Declare a numeric field of a parameter record.

    Args:
        default: value when nothing else is said.
        unit: SI unit as text ("1" for none).
        bounds: lowest and highest accepted value, both included.
        doc: meaning of the parameter.
        source: where the default comes from, or "estimated, because ...".
    """
    return dataclasses.field(
        default=default, metadata={"unit": unit, "bounds": bounds, "doc": doc, "source": source}
    )


def plain(default: str | bool, doc: str) -> Any:
    """Declare a field of a parameter record that is a text or a switch.

    Args:
        default: value when nothing else is said.
        doc: meaning of the parameter.
    """
    return dataclasses.field(default=default, metadata={"doc": doc})


def structure(read: Callable[[str, object], Any], doc: str, source: str = "") -> Any:
    """Declare a field of a parameter record that holds a structure, None by default.

    Args:
        read: makes it from a name and plain values (lists, mappings, numbers), or raises
            InputError; takes its own result as well.
        doc: meaning of the parameter.
        source: as in `param`.
    """
    return dataclasses.field(default=None, metadata={"read": read, "doc": doc, "source": source})


def as_text(value: object) -> str:
    """Return plain values as text, as ROS parameters have a structure; None is empty."""
    return "" if value is None else json.dumps(value)


def check_number(
    name: str, value: object, unit: str, bounds: tuple[float, float], integer: bool = False
) -> float:
    """Return `value` as a float, or raise InputError naming `name`, the value and the bounds."""
    accepted = f"a number from {bounds[0]:g} to {bounds[1]:g} [{unit}]"
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name}: {shown(value)} is not {accepted}")
    try:
        number = float(value)
    except OverflowError:  # a whole number beyond the range of floats
        number = math.inf
    if not math.isfinite(number) or not bounds[0] <= number <= bounds[1]:
        raise InputError(f"{name}: {shown(value)} is out of bounds; accepted: {accepted}")
    if integer and number != int(number):
        raise InputError(f"{name}: {shown(value)} is not a whole number; accepted: {accepted}")
    return number


def validate(record: Any, name: str = "") -> None:
    """Check every numeric field of `record` against its declared bounds.

    Raises:
        InputError: names the first field out of bounds, its value and the bounds.
    """
    for field in dataclasses.fields(record):
        if "bounds" in field.metadata:
            where = f"{name}.{field.name}" if name else field.name
            _number(field, getattr(record, field.name), where)


def _number(field: dataclasses.Field[Any], value: object, where: str) -> float | int:
    """Return the checked value of a numeric field, as an int where the field is one."""
    meta, integer = field.metadata, field.type in (int, "int")
    number = check_number(where, value, meta["unit"], meta["bounds"], integer)
    return int(number) if integer else number


def from_mapping(cls: type[_Record], values: Mapping[str, Any], name: str) -> _Record:
    """Build the record `cls` from a mapping (YAML, ROS parameters) and check it.

    Raises:
        InputError: unknown key, wrong type, NaN or a value out of bounds.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{name}: expected a mapping of parameters, got {shown(values)}")
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    for key in values:
        if key not in fields:
            raise unknown_name(f"key in {name}", key, fields)
    converted: dict[str, Any] = {}
    for key, value in values.items():
        if "bounds" in fields[key].metadata:
            converted[key] = _number(fields[key], value, f"{name}.{key}")
        elif "read" in fields[key].metadata:
            converted[key] = fields[key].metadata["read"](f"{name}.{key}", value)
        else:
            converted[key] = value
    return cls(**converted)


def numeric_fields(cls: type[Any]) -> list[str]:
    """Return the names of the fields of a parameter record that are numbers."""
    return [f.name for f in dataclasses.fields(cls) if "bounds" in f.metadata]

"""From a mapping of a data file to a record, with a clear error for whatever does not fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number

_Record = TypeVar("_Record")


def record(cls: type[_Record], values: object, where: str, **known: Any) -> _Record:
    """Build the record `cls` from a mapping; `known` holds fields that are already read.

    Raises:
        InputError: names a key that is unknown or missing, or a number that is out of bounds.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{where}: {shown(values)}; accepted: a mapping of keys to values")
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    accepted = [name for name, f in fields.items() if f.metadata]
    for key in values:
        if key not in accepted:
            raise unknown_name(f"key in {where}", key, accepted)
    built = dict(known)
    for name in accepted:
        optional = fields[name].default is not dataclasses.MISSING
        if values.get(name) is None and optional:
            continue
        if name not in values:
            unit = fields[name].metadata["unit"]
            raise InputError(f"{where}: no {name} [{unit}]; accepted: one is needed")
        built[name] = _field(fields[name], values[name], f"{where}.{name}")
    return cls(**built)


def _field(field: Any, value: object, where: str) -> float | int | tuple[float, ...]:
    unit, bounds = field.metadata["unit"], field.metadata["bounds"]
    if field.type.startswith("tuple"):
        if not isinstance(value, list):
            raise InputError(f"{where}: {shown(value)}; accepted: a list of numbers [{unit}]")
        return tuple(check_number(f"{where}[{i}]", v, unit, bounds) for i, v in enumerate(value))
    if field.type == "int":
        return int(check_number(where, value, unit, bounds, integer=True))
    return check_number(where, value, unit, bounds)

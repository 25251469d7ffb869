"""`model.yaml`: an extended model as a file, for readers and for `tombo fly --model`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from tombo_dynamics.effect_registry import Registry
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.extended_model import (
    FittedEffect,
    FittedParameter,
    Gain,
    Model,
    ModelSource,
    Origin,
)
from tombo_flight.yaml_file import (
    END,
    check_end,
    check_keys,
    list_of,
    mapping_of,
    write_yaml,
    yaml_of,
)

_Record = TypeVar("_Record")
FORMAT = 1
_HEAD = (
    "# A model extended by what measurements called for. Of flights: tombo fly --model THIS_FILE\n"
    "# The effects are laid over those of the scenario; docs/effects.md says what each does.\n"
)
_KEYS = ("tombo_model", "effects", "origin", "gain", "notes")
_ANY = (-math.inf, math.inf)
_SHARE = (0.0, 1.0)


def write_model(path: Path, model: Model) -> None:
    """Write a model, whole or not at all.

    Raises:
        InputError: the file can't be written.
    """
    write_yaml(path, model_text(model), f"model file '{path}'")


def model_text(model: Model) -> str:
    """Return the text of `model.yaml`."""
    values = {
        "tombo_model": FORMAT,
        "effects": {
            a.effect: {
                "confidence": a.confidence,
                "parameters": {f.name: _plain(f, without="name") for f in a.theta},
                "covariance": [list(row) for row in a.covariance],
            }
            for a in model.additions
        },
        "origin": _plain(model.origin),
        "gain": [_plain(gain) for gain in model.gain],
        "notes": list(model.notes),
    }
    vehicle = model.origin.vehicle
    with_it = f"# It is of the vehicle {vehicle}: add --vehicle and its name or file.\n"
    return f"{_HEAD}{with_it if vehicle else ''}{yaml_of(values)}{END}\n"


def _plain(record: Any, without: str = "") -> dict[str, Any]:
    values = dataclasses.asdict(record)
    values.pop(without, None)
    return values


def read_model(path: Path, registry: Registry = REGISTRY) -> Model:
    """Read and check a model; `registry` has the effects of its kind.

    Raises:
        InputError: it can't be read, is cut off or no model, or holds an unknown effect or
            parameter, or a value that no simulation takes.
    """
    what = f"model file '{path}'"
    return model_from_text(
        read_text(path, what, "a model.yaml of `tombo diagnose`"), what, registry
    )


def model_from_text(text: str, what: str, registry: Registry = REGISTRY) -> Model:
    """Return the model that a file's text holds; `what` names it in errors.

    Raises:
        InputError: as `read_model`.
    """
    values = parse_yaml(text, what)
    if not isinstance(values, Mapping) or "tombo_model" not in values:
        raise InputError(f"{what} is no model; accepted: a model.yaml of `tombo diagnose`")
    if values["tombo_model"] != FORMAT:
        found = shown(values["tombo_model"])
        raise InputError(f"{what}: tombo_model: {found}; accepted: {FORMAT}")
    check_end(text, what)
    check_keys(values, _KEYS, what)
    effects = mapping_of(values.get("effects"), f"{what}: effects")
    if not effects:
        raise InputError(f"{what}: effects: none; accepted: at least one")
    return Model(
        additions=tuple(
            _read_addition(str(name), given, f"{what}: effects.{name}", registry)
            for name, given in effects.items()
        ),
        origin=_read_origin(values.get("origin"), f"{what}: origin"),
        gain=tuple(
            _read_record(Gain, given, f"{what}: gain[{i}]")
            for i, given in enumerate(list_of(values.get("gain"), f"{what}: gain"))
        ),
        notes=tuple(str(note) for note in list_of(values.get("notes"), f"{what}: notes")),
    )


def _read_addition(name: str, given: Any, where: str, registry: Registry) -> FittedEffect:
    if name not in registry:
        raise unknown_name(f"effect in {where.rpartition('.')[0]}", name, registry)
    declared = {p.name: p for p in registry[name].theta}
    given = mapping_of(given, where)
    check_keys(given, ("confidence", "parameters", "covariance"), where)
    theta = []
    for key, value in mapping_of(given.get("parameters"), f"{where}.parameters").items():
        if key not in declared:
            raise unknown_name(f"parameter of effect '{name}' in {where}", str(key), declared)
        at, p = f"{where}.{key}", declared[key]
        value = mapping_of(value, at)
        check_keys(value, [f.name for f in dataclasses.fields(FittedParameter)][1:], at)
        theta.append(
            FittedParameter(
                p.name,
                p.unit,
                _number(value, "nominal", at, p.unit, absent=p.null),
                check_number(f"{at}.value", value.get("value"), p.unit, p.bounds),
                _number(value, "low", at, p.unit),
                _number(value, "high", at, p.unit),
            )
        )
        if value.get("unit", p.unit) != p.unit:
            raise InputError(f"{at}.unit: {shown(value['unit'])}; accepted: {p.unit}")
    if not theta:
        raise InputError(f"{where}: no parameters; accepted: at least one")
    rows = list_of(given.get("covariance"), f"{where}.covariance")
    covariance = tuple(
        tuple(check_number(f"{where}.covariance", v, "1", _ANY) for v in list_of(row, where))
        for row in rows
    )
    if covariance and {len(covariance), *map(len, covariance)} != {len(theta)}:
        raise InputError(f"{where}.covariance: accepted: {len(theta)} rows of {len(theta)}")
    confidence = _number(given, "confidence", where, "1", _SHARE)
    return FittedEffect(name, tuple(theta), confidence, covariance)


def _read_origin(given: Any, where: str) -> Origin:
    values = mapping_of({} if given is None else given, where)
    flights = list_of(values.get("flights"), f"{where}.flights")
    origin = _read_record(Origin, values, where, ("flights",))
    sources = [
        _read_record(ModelSource, f, f"{where}.flights[{i}]") for i, f in enumerate(flights)
    ]
    confidence = _number(values, "confidence", where, "1", _SHARE)
    return dataclasses.replace(origin, confidence=confidence, flights=tuple(sources))


def _read_record(
    kind: type[_Record], given: Any, where: str, more: tuple[str, ...] = ()
) -> _Record:
    """Return a record of texts and numbers; `more` are keys that are read elsewhere."""
    values = mapping_of(given, where)
    fields = {f.name: f.type for f in dataclasses.fields(kind) if f.name not in more}  # type: ignore[arg-type]
    check_keys(values, (*fields, *more), where)
    read: dict[str, Any] = {}
    for name, wanted in fields.items():
        if wanted == "str":
            read[name] = str(values.get(name) or "")
        elif wanted == "int":
            read[name] = int(
                check_number(f"{where}.{name}", values.get(name, 0), "1", (0.0, 1e6), True)
            )
        else:
            read[name] = _number(values, name, where)
    return kind(**read)


def _number(
    values: Mapping[str, Any],
    key: str,
    where: str,
    unit: str = "1",
    bounds: tuple[float, float] = _ANY,
    absent: float = math.nan,
) -> float:
    """Return a number, `absent` where there is none."""
    value = values.get(key)
    return absent if value is None else check_number(f"{where}.{key}", value, unit, bounds)

"""`model.yaml`: an extended model as a file, for readers and for `tombo fly --model`."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.yaml_text import parse_yaml
from tombo_flight.extended_model import FittedEffect, FittedParameter, Gain, Model, Origin, Source

FORMAT = 1
_END = "..."
"""YAML's end of a document: a file without it has lost its end."""
_HEAD = (
    "# A model extended by what measured flights called for. Fly it: tombo fly --model THIS_FILE\n"
    "# The effects are laid over those of the scenario; docs/effects.md says what each does.\n"
)
_KEYS = ("tombo_model", "effects", "origin", "gain", "notes")
_ANY = (-math.inf, math.inf)
_SHARE = (0.0, 1.0)
_LARGEST = 4_000_000
"""Bytes; a model is a few thousand."""


def write_model(path: Path, model: Model) -> None:
    """Write a model, whole or not at all.

    Raises:
        InputError: the file can't be written.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        unfinished.write_text(model_text(model), encoding="utf-8", newline="\n")
        os.replace(unfinished, path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise InputError(f"model file '{path}' can't be written: {error.strerror}") from error


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
    text = yaml.dump(
        _writable(values),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None,
        width=99,
    )
    return f"{_HEAD}{text}{_END}\n"


class _Dumper(yaml.SafeDumper):
    """Writes repeated values without anchors, and every character so that it is read back."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if text.isprintable() else '"'  # plain and single quotes lose odd line breaks
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def _plain(record: Any, without: str = "") -> dict[str, Any]:
    values = dataclasses.asdict(record)
    values.pop(without, None)
    return values


def _writable(value: Any) -> Any:
    """Return plain values: what is not finite becomes null, numpy's numbers Python's."""
    if isinstance(value, Mapping):
        return {str(key): _writable(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_writable(inner) for inner in value]
    if isinstance(value, str | bool | int):
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def read_model(path: Path) -> Model:
    """Read and check a model.

    Raises:
        InputError: it can't be read, is cut off or no model, or holds an unknown effect or
            parameter, or a value that no simulation takes.
    """
    what = f"model file '{path}'"
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{what}: too large; accepted: a model.yaml of `tombo diagnose`")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{what} can't be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{what} is no text; accepted: a model.yaml") from error
    return model_from_text(text, what)


def model_from_text(text: str, what: str) -> Model:
    """Return the model that a file's text holds; `what` names it in errors.

    Raises:
        InputError: as `read_model`.
    """
    values = parse_yaml(text, what)
    if not isinstance(values, Mapping) or "tombo_model" not in values:
        raise InputError(f"{what} is no model; accepted: a model.yaml of `tombo diagnose`")
    if values["tombo_model"] != FORMAT:
        found = f"{values['tombo_model']!r:.40}"
        raise InputError(f"{what}: tombo_model: {found}; accepted: {FORMAT}")
    if text.rstrip().rpartition("\n")[2] != _END:
        raise InputError(f"{what} is cut off: its last line is not '{_END}'")
    _known(values, _KEYS, what)
    effects = _mapping(values.get("effects"), f"{what}: effects")
    if not effects:
        raise InputError(f"{what}: effects: none; accepted: at least one")
    return Model(
        additions=tuple(
            _read_addition(str(name), given, f"{what}: effects.{name}")
            for name, given in effects.items()
        ),
        origin=_read_origin(values.get("origin"), f"{what}: origin"),
        gain=tuple(
            _read_gain(given, f"{what}: gain[{i}]")
            for i, given in enumerate(_list(values.get("gain"), f"{what}: gain"))
        ),
        notes=tuple(str(note) for note in _list(values.get("notes"), f"{what}: notes")),
    )


def _read_addition(name: str, given: Any, where: str) -> FittedEffect:
    if name not in REGISTRY:
        raise unknown_name(f"effect in {where.rpartition('.')[0]}", name, REGISTRY)
    declared = {p.name: p for p in REGISTRY[name].theta}
    given = _mapping(given, where)
    _known(given, ("confidence", "parameters", "covariance"), where)
    theta = []
    for key, value in _mapping(given.get("parameters"), f"{where}.parameters").items():
        if key not in declared:
            raise unknown_name(f"parameter of effect '{name}' in {where}", str(key), declared)
        at, p = f"{where}.{key}", declared[key]
        value = _mapping(value, at)
        _known(value, [f.name for f in dataclasses.fields(FittedParameter)][1:], at)
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
            raise InputError(f"{at}.unit: {value['unit']!r:.40}; accepted: {p.unit}")
    if not theta:
        raise InputError(f"{where}: no parameters; accepted: at least one")
    rows = _list(given.get("covariance"), f"{where}.covariance")
    covariance = tuple(
        tuple(check_number(f"{where}.covariance", v, "1", _ANY) for v in _list(row, where))
        for row in rows
    )
    if covariance and {len(covariance), *map(len, covariance)} != {len(theta)}:
        raise InputError(f"{where}.covariance: accepted: {len(theta)} rows of {len(theta)}")
    confidence = _number(given, "confidence", where, "1", _SHARE)
    return FittedEffect(name, tuple(theta), confidence, covariance)


def _read_origin(given: Any, where: str) -> Origin:
    values = dict(_mapping({} if given is None else given, where))
    _known(values, [f.name for f in dataclasses.fields(Origin)], where)
    flights = [
        _mapping(flight, f"{where}.flights[{i}]")
        for i, flight in enumerate(_list(values.get("flights"), f"{where}.flights"))
    ]
    names = ("tool", "date", "verdict", "summary", "scenario", "extends", "vehicle")
    texts = {name: str(values.get(name) or "") for name in names}
    return Origin(
        **texts,
        confidence=_number(values, "confidence", where, "1", _SHARE),
        flights=tuple(
            Source(
                str(flight.get("name", "")),
                str(flight.get("source", "")),
                _number(flight, "used_s", where, "s"),
                str(flight.get("formulation", "")),
            )
            for flight in flights
        ),
    )


def _read_gain(given: Any, where: str) -> Gain:
    values = _mapping(given, where)
    _known(values, [f.name for f in dataclasses.fields(Gain)], where)
    flights = check_number(f"{where}.flights", values.get("flights", 0), "1", (0.0, 1e6), True)
    fields: dict[str, Any] = {k: str(values.get(k, "")) for k in ("channel", "unit", "horizon")}
    for key in ("before", "after", "reduction", "low", "high"):
        fields[key] = _number(values, key, where)
    return Gain(**fields, flights=int(flights))


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: {f'{value!r:.60}'}; accepted: a mapping of keys to values")
    return value


def _list(value: Any, where: str) -> list[Any]:
    if value is None:
        return []
    if not isinstance(value, list):
        raise InputError(f"{where}: {f'{value!r:.60}'}; accepted: a list")
    return value


def _known(values: Mapping[str, Any], accepted: Any, where: str) -> None:
    for key in values:
        if key not in accepted:
            raise unknown_name(f"key in {where}", str(key), accepted)


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

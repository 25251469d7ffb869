"""An extended model: the effects found in flights, and the source of each number.

`model.yaml` is its file, for readers and for `tombo fly --model`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from tombo_dynamics.effect_registry import Registry
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number, from_mapping
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.yaml_file import check_keys, list_of, mapping_of, write_yaml, yaml_of

FORMAT = 1
_Record = TypeVar("_Record")
_HEAD = (
    "# A model extended by what measurements called for. Of flights: tombo fly --model THIS_FILE\n"
    "# The effects are laid over those of the scenario; docs/effects.md says what each does.\n"
)
_KEYS = ("tombo_model", "effects", "origin", "gain", "notes")


@dataclass(frozen=True)
class FittedParameter:
    """A fitted parameter of an effect."""

    name: str
    unit: str
    nominal: float
    value: float
    low: float
    """End of the 95 % interval."""
    high: float


@dataclass(frozen=True)
class Gain:
    """Prediction error of a channel before and after, on data held out from selection and fit."""

    channel: str
    unit: str
    horizon: str
    """"one step" (equation error) or "0.5 s", "1 s" (open-loop simulation)."""
    before: float
    """RMS over the held-out flights."""
    after: float
    reduction: float
    """1 - after / before."""
    low: float
    """End of the 95 % interval of the reduction, over flights; NaN with fewer than three."""
    high: float
    flights: int


@dataclass(frozen=True)
class FittedEffect:
    """An effect of the model with its fitted parameters."""

    effect: str
    theta: tuple[FittedParameter, ...]
    confidence: float
    covariance: tuple[tuple[float, ...], ...] = ()
    """Covariance of theta, in its order; empty: not known."""


@dataclass(frozen=True)
class ModelSource:
    """A flight that the model was fitted on."""

    name: str
    source: str
    used_s: float
    formulation: str


@dataclass(frozen=True)
class Origin:
    """Origin of the model."""

    tool: str = ""
    """Name and version of what fitted it."""
    date: str = ""
    verdict: str = ""
    confidence: float = math.nan
    summary: str = ""
    scenario: str = ""
    """Name of the nominal scenario, with the effects before the fit."""
    extends: str = ""
    """The model that it was made from, if any."""
    flights: tuple[ModelSource, ...] = ()
    vehicle: str = ""
    """Whose flights they were; empty: the suite's own vehicle."""


@dataclass(frozen=True)
class Model:
    """Content of `model.yaml`."""

    additions: tuple[FittedEffect, ...]
    origin: Origin
    gain: tuple[Gain, ...] = ()
    """Prediction error before and after, on data held out."""
    notes: tuple[str, ...] = ()

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """Effect → parameter → value, as in a scenario."""
        return {a.effect: {f.name: f.value for f in a.theta} for a in self.additions}


def merge_effects(
    effects: Mapping[str, Mapping[str, float]], model: Model
) -> dict[str, dict[str, float]]:
    """Return a scenario's effects, updated with the model's parameters."""
    result = {name: dict(values) for name, values in effects.items()}
    for name, values in model.effects.items():
        result[name] = {**result.get(name, {}), **values}
    return result


def write_model(path: Path, model: Model) -> None:
    """Write a model, whole or not at all.

    Raises:
        InputError: the file can't be written.
    """
    write_yaml(path, model_text(model), f"model file '{path}'")


def model_text(model: Model) -> str:
    """Return the text of `model.yaml`."""
    plain = dataclasses.asdict(model)
    values = {
        "tombo_model": FORMAT,
        "effects": {
            addition["effect"]: {
                "confidence": addition["confidence"],
                "parameters": {fitted.pop("name"): fitted for fitted in addition["theta"]},
                "covariance": [list(row) for row in addition["covariance"]],
            }
            for addition in plain["additions"]
        },
        **{key: plain[key] for key in ("origin", "gain", "notes")},
    }
    vehicle = model.origin.vehicle
    with_it = f"# It is of the vehicle {vehicle}: add --vehicle and its name or file.\n"
    return f"{_HEAD}{with_it if vehicle else ''}{yaml_of(values)}"


def read_model(path: Path, registry: Registry = REGISTRY) -> Model:
    """Read and check a model; `registry` has the effects of its kind.

    Raises:
        InputError: it can't be read, isn't a model, or has an unknown effect or parameter, or
            a value that the simulation does not accept.
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
        raise InputError(f"{what} is not a model; accepted: a model.yaml of `tombo diagnose`")
    if values["tombo_model"] != FORMAT:
        found = shown(values["tombo_model"])
        raise InputError(f"{what}: tombo_model: {found}; accepted: {FORMAT}")
    check_keys(values, _KEYS, what)
    effects = mapping_of(values.get("effects"), f"{what}: effects")
    if not effects:
        raise InputError(f"{what}: effects: none; accepted: at least one")
    origin = dict(mapping_of(values.get("origin") or {}, f"{what}: origin"))
    flights = [
        _record(ModelSource, flight, f"{what}: origin.flights")
        for flight in list_of(origin.pop("flights", None), f"{what}: origin.flights")
    ]
    gain = list_of(values.get("gain"), f"{what}: gain")
    return Model(
        additions=tuple(
            _read_addition(str(name), given, f"{what}: effects.{name}", registry)
            for name, given in effects.items()
        ),
        origin=dataclasses.replace(
            _record(Origin, origin, f"{what}: origin"), flights=tuple(flights)
        ),
        gain=tuple(_record(Gain, given, f"{what}: gain") for given in gain),
        notes=tuple(str(note) for note in list_of(values.get("notes"), f"{what}: notes")),
    )


def _record(kind: type[_Record], given: Any, where: str, **more: Any) -> _Record:
    """Return a record of texts and numbers; a number without a value is NaN."""
    values = {
        key: math.nan if value is None else value
        for key, value in mapping_of(given, where).items()
    }
    return from_mapping(kind, {**more, **values}, where)


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
        p = declared[key]
        absent = FittedParameter(key, p.unit, p.null, math.nan, math.nan, math.nan)
        fitted = _record(FittedParameter, value, f"{where}.{key}", **vars(absent))
        if fitted.unit != p.unit:
            raise InputError(f"{where}.{key}.unit: {shown(fitted.unit)}; accepted: {p.unit}")
        number = check_number(f"{where}.{key}.value", fitted.value, p.unit, p.bounds)
        theta.append(dataclasses.replace(fitted, value=number))
    if not theta:
        raise InputError(f"{where}: no parameters; accepted: at least one")
    covariance = tuple(tuple(row) for row in list_of(given.get("covariance"), where))
    confidence = given.get("confidence")
    return FittedEffect(
        name, tuple(theta), math.nan if confidence is None else confidence, covariance
    )

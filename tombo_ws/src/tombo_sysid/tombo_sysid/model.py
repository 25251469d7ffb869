"""An extended model: the effects that flights called for, and where each number comes from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_sysid.diagnosis import Cause, Diagnosis, Fitted, Gain

EXTENDS = ("named", "partly_explained")
"""Verdicts that say what the model lacks; the others leave it as it is."""


@dataclass(frozen=True)
class Addition:
    """An effect of the model with its fitted parameters."""

    effect: str
    theta: tuple[Fitted, ...]
    confidence: float
    covariance: tuple[tuple[float, ...], ...] = ()
    """Of theta, in its order; empty: not known."""


@dataclass(frozen=True)
class Source:
    """A flight that the model was fitted on."""

    name: str
    source: str
    used_s: float
    formulation: str


@dataclass(frozen=True)
class Origin:
    """How the model came to be."""

    tool: str
    """Name and version of what fitted it."""
    date: str
    verdict: str
    confidence: float
    summary: str
    scenario: str
    """What it was held against: name of the scenario with the effects before."""
    extends: str = ""
    """The model that it was made from, if any."""
    flights: tuple[Source, ...] = ()
    vehicle: str = ""
    """Whose flights they were; empty: the suite's own vehicle."""


@dataclass(frozen=True)
class Model:
    """What `model.yaml` holds."""

    additions: tuple[Addition, ...]
    origin: Origin
    gain: tuple[Gain, ...] = ()
    """Prediction error before and after, on data held out."""
    notes: tuple[str, ...] = ()

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """Effect → parameter → value, as in a scenario."""
        return {a.effect: {f.name: f.value for f in a.theta} for a in self.additions}


def effects_over(
    effects: Mapping[str, Mapping[str, float]], model: Model
) -> dict[str, dict[str, float]]:
    """Return a scenario's effects with the model's laid over them, parameter by parameter."""
    result = {name: dict(values) for name, values in effects.items()}
    for name, values in model.effects.items():
        result[name] = {**result.get(name, {}), **values}
    return result


def model_of(
    diagnosis: Diagnosis,
    *,
    tool: str,
    date: str,
    scenario: str,
    base: Model | None = None,
) -> Model:
    """Return the model that a diagnosis asks for.

    Args:
        diagnosis: its causes are put in.
        tool: name and version of what made the diagnosis.
        date: of today, as text.
        scenario: name of what the flights were held against.
        base: the model that was laid over it, if any; what it holds stays.

    Raises:
        InputError: nothing was named, or a cause is not of the registry.
    """
    if diagnosis.verdict not in EXTENDS or not diagnosis.causes:
        raise InputError(
            f"model: the verdict '{diagnosis.verdict}' names no effect to extend the model by; "
            f"accepted: {' or '.join(EXTENDS)}, with a cause"
        )
    notes: list[str] = []
    fitted = [_addition(cause, notes) for cause in diagnosis.causes]
    origin = Origin(
        tool=tool,
        date=date,
        verdict=diagnosis.verdict,
        confidence=diagnosis.confidence,
        summary=diagnosis.summary,
        scenario=scenario,
        vehicle=diagnosis.vehicle,
        extends=diagnosis.model if base is not None else "",
        flights=tuple(
            Source(f.name, f.source, f.used_s, f.formulation) for f in diagnosis.flights
        ),
    )
    if base is not None:
        notes = [*base.notes, *notes]
        fitted = _merged(base.additions, fitted)
    return Model(tuple(fitted), origin, diagnosis.gain, (*notes, *diagnosis.notes))


def _addition(cause: Cause, notes: list[str]) -> Addition:
    """Return what a cause adds; a value that no simulation takes is brought to its bound."""
    if cause.effect not in REGISTRY:
        raise InputError(f"model: effect '{cause.effect}' is not in the registry")
    declared = {p.name: p for p in REGISTRY[cause.effect].theta}
    theta = []
    for fitted in cause.theta:
        name = f"{cause.effect}.{fitted.name}"
        if fitted.name not in declared or not math.isfinite(fitted.value):
            raise InputError(f"model: {name} = {fitted.value} can't be flown")
        low, high = declared[fitted.name].bounds
        value = min(max(fitted.value, low), high)
        if value != fitted.value:
            notes.append(f"{name}: {fitted.value:g} was fitted, {value:g} is its bound")
        theta.append(replace(fitted, value=value, unit=declared[fitted.name].unit))
    return Addition(cause.effect, tuple(theta), cause.confidence, cause.covariance)


def _merged(base: tuple[Addition, ...], fitted: list[Addition]) -> list[Addition]:
    """Return the additions of both; a parameter that was fitted anew replaces the old one.

    A covariance stays where its effect's parameters are all of one fit.
    """
    result = {addition.effect: addition for addition in base}
    for new in fitted:
        old = result.get(new.effect)
        names = {f.name for f in new.theta}
        kept = tuple(f for f in old.theta if f.name not in names) if old is not None else ()
        if kept:
            new = replace(new, theta=(*kept, *new.theta), covariance=())
        result[new.effect] = new
    return list(result.values())

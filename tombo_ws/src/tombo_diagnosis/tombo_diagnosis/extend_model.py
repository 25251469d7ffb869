"""The extended model: the causes of a diagnosis, added to the model that was known."""

from __future__ import annotations

import math
from dataclasses import replace

from tombo_diagnosis.diagnosis import Cause, Diagnosis
from tombo_dynamics.effect_registry import Registry
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import FittedEffect, Model, ModelSource, Origin

EXTENDING_VERDICTS = ("named", "partly_explained")
"""Verdicts with causes that extend the model."""


def extends(diagnosis: Diagnosis) -> bool:
    """Return whether something is named, so that the model can be extended."""
    return diagnosis.verdict in EXTENDING_VERDICTS and bool(diagnosis.causes)


def model_of(
    diagnosis: Diagnosis,
    *,
    tool: str,
    date: str,
    scenario: str,
    base: Model | None = None,
    registry: Registry = REGISTRY,
) -> Model:
    """Return the model, extended by the causes of a diagnosis.

    Args:
        diagnosis: its causes are put in.
        tool: that made the diagnosis, with its version.
        date: of today, as text.
        scenario: name of the model that the data were compared with.
        base: an extended model that the data were compared with, if any; its effects stay.
        registry: of the effects: of flights, or of thrust stands.

    Raises:
        InputError: nothing was named, or a cause is not of the registry.
    """
    if not extends(diagnosis):
        raise InputError(
            f"model: the verdict '{diagnosis.verdict}' names no effect to extend the model by; "
            f"accepted: {' or '.join(EXTENDING_VERDICTS)}, with a cause"
        )
    notes: list[str] = []
    fitted = [_addition(cause, registry, notes) for cause in diagnosis.causes]
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
            ModelSource(f.name, f.source, f.used_s, f.formulation) for f in diagnosis.flights
        ),
    )
    if base is not None:
        notes = [*base.notes, *notes]
        fitted = _merged(base.additions, fitted)
    return Model(tuple(fitted), origin, diagnosis.gain, (*notes, *diagnosis.notes))


def _addition(cause: Cause, registry: Registry, notes: list[str]) -> FittedEffect:
    """Return the addition of a cause; a value beyond the bounds is brought to its bound."""
    if cause.effect not in registry:
        raise InputError(f"model: effect '{cause.effect}' is not in the registry")
    declared = {p.name: p for p in registry[cause.effect].theta}
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
    return FittedEffect(cause.effect, tuple(theta), cause.confidence, cause.covariance)


def _merged(base: tuple[FittedEffect, ...], fitted: list[FittedEffect]) -> list[FittedEffect]:
    """Return the additions of both; a parameter that was fitted again replaces the old one.

    A covariance stays where its effect's parameters are all of one fit.
    """
    result = {addition.effect: addition for addition in base}
    for new in fitted:
        old = result.get(new.effect)
        names = {f.name for f in new.theta}
        unchanged = tuple(f for f in old.theta if f.name not in names) if old is not None else ()
        if unchanged:
            new = replace(new, theta=(*unchanged, *new.theta), covariance=())
        result[new.effect] = new
    return list(result.values())

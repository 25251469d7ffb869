"""Causes compared with the model that was given: what differs, and what extends it."""

from __future__ import annotations

from collections.abc import Sequence

from tombo_diagnosis.diagnosis import Cause
from tombo_diagnosis.wording import display_name
from tombo_dynamics.propeller.effects import STAND_EFFECTS
from tombo_flight.extended_model import FittedParameter


def differences_from_model(causes: Sequence[Cause]) -> list[str]:
    """Return, of each cause that the model has a value of, how these runs depart from it."""
    return [_told(c, f) for c in causes for f in _given(c)[:1]]


def model_extending_causes(causes: Sequence[Cause]) -> list[Cause]:
    """Return the causes that extend a model: not stochastic, and not just absent in these runs."""
    return [c for c in causes if not STAND_EFFECTS[c.effect].stochastic and not _absent(c)]


def _given(cause: Cause) -> list[FittedParameter]:
    """Return the parameters of which the model has a value of its own."""
    effect = STAND_EFFECTS[cause.effect]
    if effect.stochastic:
        return []
    nulls = {p.name: p.null for p in effect.theta}
    return [f for f in cause.theta if f.nominal != nulls[f.name]]


def _absent(cause: Cause) -> bool:
    """Return whether the model has it and these runs have not."""
    nulls = {p.name: p.null for p in STAND_EFFECTS[cause.effect].theta}
    given = _given(cause)
    return bool(given) and all(f.low <= nulls[f.name] <= f.high for f in cause.theta)


def _told(cause: Cause, f: FittedParameter) -> str:
    name, unit = display_name(cause.effect), "" if f.unit == "1" else f" {f.unit}"
    here = f"{f.value:.2g} ± {0.5 * (f.high - f.low):.1g}{unit}"
    if _absent(cause):
        return f"the model’s {name} {f.nominal:.3g}{unit} is not in these runs ({here})"
    return f"{name} is {here} in these runs, {f.nominal:.3g}{unit} in the model"

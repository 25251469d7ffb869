"""An extended model: the effects found in flights, and the source of each number."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass


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
    """Of theta, in its order; empty: not known."""


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

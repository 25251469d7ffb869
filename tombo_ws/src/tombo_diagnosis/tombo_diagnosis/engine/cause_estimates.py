"""Parameters of causes with intervals, and the score of every candidate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType

import numpy as np

from tombo_diagnosis.diagnosis import Score
from tombo_diagnosis.engine.detectable import Detectable
from tombo_diagnosis.engine.model import Explanation, Model
from tombo_diagnosis.engine.regression import Parameter
from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import FittedParameter

TWO_SIDED = 1.96
"""Standard deviations from the middle of a 95 % interval to its ends."""
_MODEL_ERROR = 0.015
"""Error of the model, as a share of the fitted change: no change is known better than this."""
_MAX_LOG_BF = 700.0

Covariance = tuple[tuple[float, ...], ...]
Estimate = tuple[tuple[FittedParameter, ...], Covariance]
"""Parameters of a cause, and their covariance."""


def fitted_parameter(
    p: Parameter, nominal: float, value: float, deviation: float
) -> FittedParameter:
    """Return a parameter with its 95 % interval, in its bounds."""
    half = TWO_SIDED * math.hypot(deviation, _MODEL_ERROR * abs(value - nominal))
    low, high = max(value - half, p.low), min(value + half, p.high)
    return FittedParameter(p.name, p.unit, nominal, value, min(low, value), max(high, value))


def as_tuples(covariance: Array) -> Covariance:
    """Return a matrix (K, K) as plain numbers."""
    return tuple(tuple(float(v) for v in row) for row in covariance)


def fitted_parameters(model: Model, explanation: Explanation, effect: str) -> Estimate:
    """Return the parameters of a cause with a mean, and their covariance."""
    free = sorted(i for h in explanation.hypotheses if h.effect == effect for i in h.free)
    places = model.columns.places(free)
    theta = model.final(explanation.fit)
    spread = explanation.fit.solution.covariance[np.ix_(places, places)]
    deviations = np.sqrt(np.maximum(np.diag(spread), 0.0))
    found = tuple(
        fitted_parameter(
            model.columns.parameters[i], float(model.theta[i]), float(theta[i]), float(d)
        )
        for i, d in zip(free, deviations, strict=True)
    )
    return found, as_tuples(spread)


def scores(
    log_bf: Mapping[str, float],
    shares: Mapping[str, float],
    effects: Iterable[str],
    why_not: Callable[[str], str],
    detectable: Mapping[str, Detectable] = MappingProxyType({}),
) -> tuple[Score, ...]:
    """Return the scores of all effects, most probable first.

    Args:
        log_bf: effect -> log Bayes factor of it alone, of those that the data can show.
        shares: effect -> share of the excess that it removes in held-out data; of those fitted.
        effects: all of the registry that make sense for the model.
        why_not: says of an effect why the data can't show it.
        detectable: effect -> the smallest change that the data would have shown.
    """
    finite = {e: max(min(float(v), _MAX_LOG_BF), -_MAX_LOG_BF) for e, v in log_bf.items()}
    total = float(np.logaddexp.reduce([0.0, *finite.values()]))
    found = []
    for effect in effects:
        share = shares.get(effect, math.nan)
        if effect in finite:
            evidence = finite[effect]
            probability, least = math.exp(evidence - total), detectable.get(effect)
            found.append(Score(effect, share, evidence, probability, True, "", least))
        else:
            found.append(Score(effect, share, 0.0, 0.0, False, why_not(effect)))
    return tuple(sorted(found, key=lambda s: (-s.excited, -s.evidence)))

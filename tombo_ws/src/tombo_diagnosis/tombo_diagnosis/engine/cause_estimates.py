"""Causes in figures: parameters with intervals, scores, what data would show, and the gain."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from scipy import stats

from tombo_diagnosis.diagnosis import Detectable, Score
from tombo_diagnosis.engine.model import Explanation, RegressionModel
from tombo_diagnosis.engine.model_selection import LOG_BF_FIRST
from tombo_diagnosis.engine.regression import Fit, FreeParameter, solve
from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import FittedParameter, Gain

_MIN_BLOCKS_FOR_INTERVAL = 3
"""Least number of held-out blocks for an interval."""


def rms(values: Array) -> float:
    """Return the root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def gain_of(
    channel: str, unit: str, horizon: str, before: Sequence[float], after: Sequence[float]
) -> Gain:
    """Return a channel's gain; its interval from the logarithms of after over before.

    `before` and `after`: RMS error in each block held out, of the model as it was and extended.
    """
    b, a = np.array(before), np.array(after)
    total_before, total_after = rms(b), rms(a)
    reduction = 1.0 - total_after / total_before if total_before > 0.0 else 0.0
    low = high = math.nan
    if b.size >= _MIN_BLOCKS_FOR_INTERVAL and (b > 0.0).all() and (a > 0.0).all():
        logs = np.log(a / b)
        half = float(stats.t.ppf(0.975, b.size - 1)) * float(logs.std(ddof=1)) / math.sqrt(b.size)
        low = min(1.0 - math.exp(float(logs.mean()) + half), reduction)
        high = max(1.0 - math.exp(float(logs.mean()) - half), reduction)
    return Gain(
        channel, unit, horizon, total_before, total_after, reduction, low, high, int(b.size)
    )


TWO_SIDED = 1.96
"""Standard deviations from the middle of a 95 % interval to its ends."""
_MODEL_ERROR = 0.015
"""Error of the model, as a share of the fitted change: no change is known better than this."""
_MAX_LOG_BF = 1e9
"""Evidence that is not finite counts as this: far beyond any other, so that no candidates tie."""

Covariance = tuple[tuple[float, ...], ...]
ParameterEstimate = tuple[tuple[FittedParameter, ...], Covariance]
"""Parameters of a cause, and their covariance."""


def fitted_parameter(
    p: FreeParameter, nominal: float, value: float, deviation: float
) -> FittedParameter:
    """Return a parameter with its 95 % interval, in its bounds."""
    half = TWO_SIDED * math.hypot(deviation, _MODEL_ERROR * abs(value - nominal))
    low, high = max(value - half, p.low), min(value + half, p.high)
    return FittedParameter(p.name, p.unit, nominal, value, min(low, value), max(high, value))


def as_tuples(covariance: Array) -> Covariance:
    """Return a matrix (K, K) as plain numbers."""
    return tuple(tuple(float(v) for v in row) for row in covariance)


def fitted_parameters(
    model: RegressionModel, explanation: Explanation, effect: str
) -> ParameterEstimate:
    """Return the parameters of a cause with a mean, and their covariance."""
    free = sorted(i for h in explanation.hypotheses if h.effect == effect for i in h.free)
    places = model.unknowns.places(free)
    theta = model.final(explanation.fit)
    spread = explanation.fit.solution.covariance[np.ix_(places, places)]
    deviations = np.sqrt(np.maximum(np.diag(spread), 0.0))
    parameters = tuple(
        fitted_parameter(
            model.unknowns.parameters[i], float(model.theta[i]), float(theta[i]), float(d)
        )
        for i, d in zip(free, deviations, strict=True)
    )
    return parameters, as_tuples(spread)


def scores(
    log_bf: Mapping[str, float],
    shares: Mapping[str, float],
    effects: Iterable[str],
    why_not: Callable[[str], str],
    detectable: Mapping[str, Detectable] = MappingProxyType({}),
) -> tuple[Score, ...]:
    """Return the scores of all effects, most probable first.

    Args:
        log_bf: effect -> log Bayes factor of it alone, where the data can show it.
        shares: effect -> share of the excess that it removes in held-out data; of those fitted.
        effects: all of the registry that make sense for the model.
        why_not: says of an effect why the data can't show it.
        detectable: effect -> the smallest change that the data would have shown.
    """
    finite = {e: max(min(float(v), _MAX_LOG_BF), -_MAX_LOG_BF) for e, v in log_bf.items()}
    total = float(np.logaddexp.reduce([0.0, *finite.values()]))
    candidates = []
    for effect in effects:
        share = shares.get(effect, math.nan)
        if effect in finite:
            evidence = finite[effect]
            probability, least = math.exp(evidence - total), detectable.get(effect)
            candidates.append(Score(effect, share, evidence, probability, True, "", least))
        else:
            candidates.append(Score(effect, share, 0.0, 0.0, False, why_not(effect)))
    return tuple(sorted(candidates, key=lambda s: (-s.excited, -s.evidence)))


def detectable_changes(model: RegressionModel, fit: Fit) -> dict[str, Detectable]:
    """Return effect -> the parameter that shows best in its scale, and how small it may be.

    A change is shown if its expected log Bayes factor reaches the threshold of a cause: a width of
    the parameter's scale against one of its tolerance. All other parameters are within
    their tolerances. Gaussian, about the fit given.
    """
    best: dict[str, tuple[float, Detectable]] = {}
    unknowns = model.unknowns
    for index in unknowns.identifiable:
        p, (place,) = unknowns.parameters[index], unknowns.places([index])
        deviations = unknowns.deviations(
            (*fit.free, index), fit.prior_std_scale, pinned=fit.pinned
        )
        variance = float(solve(fit.normal, deviations, fit.prior_mean).covariance[place, place])
        noise = 1.0 / max(1.0 / max(variance, 1e-300) - p.scale**-2, 1e-300)
        size = _threshold(math.sqrt(noise), p.tolerance, p.scale, len(unknowns.variants[p.effect]))
        share = size / p.scale
        if p.effect not in best or share < best[p.effect][0]:
            best[p.effect] = share, Detectable(p.name, p.unit, size)
    return {effect: change for effect, (_, change) in best.items()}


def _threshold(noise: float, tolerance: float, scale: float, variants: int) -> float:
    """Return the size at which a parameter measured with this noise is accepted as a cause."""
    healthy, wide = noise**2 + tolerance**2, noise**2 + scale**2
    needed = LOG_BF_FIRST + math.log(max(variants, 1)) + 0.5 * math.log(wide / healthy)
    return math.sqrt(2.0 * needed / (1.0 / healthy - 1.0 / wide))

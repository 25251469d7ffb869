"""Each configuration of Table III predicted by the others, under each physical extension."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import STAND_EFFECTS, Param, predict

MEAN = "mean of the others"
PHYSICAL = (
    *("centrifugal_stiffening", "torsion_constant", "load_sharing", "in_plane_term"),
    *("thrust_coefficient", "inflow", "air_density", "rpm_scale", "thrust_tare", "thrust_gain"),
)
"""What may be tried on thrust at one speed."""


@dataclass(frozen=True)
class Prediction:
    """How well something predicts the thrust of a configuration left out."""

    what: str
    rmse: float
    """Over the soft configurations, each predicted by the others [N]."""
    low: float
    """End of the 95 % interval of the difference of the squared errors to those of the mean, as a
    root with its sign [N]: above 0 is worse than the mean."""
    high: float
    parameter: str
    """Fitted to all, with unit; empty: none."""


def predictions(
    points: OperatingPoints, soft: NDArray[np.bool_], law: str
) -> tuple[Prediction, ...]:
    """Leave one soft configuration out after the other; least squares, each counts alike."""
    y = points.readings[:, 0]
    places = np.flatnonzero(soft)
    means = np.array([y[[k for k in places if k != out]].mean() for out in places]) - y[places]
    found = [_compared(MEAN, means, means, "")]
    bare = predict(points.setup, {})[places, 0] - y[places]
    found.append(_compared(f"law {law} as it is", bare, means, ""))
    for effect in PHYSICAL:
        parameter = STAND_EFFECTS[effect].theta[0]
        values, errors = errors_by_value(points, soft, effect)
        left = []
        for k in range(places.size):
            left.append(float(errors[_least_squares(np.delete(errors, k, axis=1)), k]))
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        shown = f"{parameter.name} = {values[_least_squares(errors)]:.3g}{unit}"
        found.append(_compared(effect, np.array(left), means, shown))
    return tuple(sorted(found, key=lambda e: e.rmse))


def errors_by_value(
    points: OperatingPoints, soft: NDArray[np.bool_], effect: str
) -> tuple[Array, Array]:
    """Return values (V,) of an effect's first parameter, and errors of thrust (V, soft) [N]."""
    values = values_of(STAND_EFFECTS[effect].theta[0])
    table = np.stack([predict(points.setup, {effect: (v,)})[soft, 0] for v in values])
    return values, np.where(np.isfinite(table), table - points.readings[soft, 0], np.inf)


def least_squares_fit(points: OperatingPoints, soft: NDArray[np.bool_], effect: str) -> float:
    """Return an effect's parameter that fits the soft configurations' thrust best."""
    values, errors = errors_by_value(points, soft, effect)
    return float(values[_least_squares(errors)])


def _least_squares(errors: Array) -> int:
    return int(np.argmin((errors**2).sum(axis=1)))


def _compared(what: str, errors: Array, means: Array, parameter: str) -> Prediction:
    """Return the error left out, and how its square differs from the mean's (t interval)."""
    gap = errors**2 - means**2
    low = high = 0.0
    if np.ptp(gap) > 0.0:
        half = 2.306 * float(gap.std(ddof=1)) / math.sqrt(gap.size)  # t, 8 degrees of freedom
        ends = (float(gap.mean()) + s * half for s in (-1.0, 1.0))
        low, high = (math.copysign(math.sqrt(abs(end)), end) for end in ends)
    return Prediction(what, float(np.sqrt(np.mean(errors**2))), low, high, parameter)


def values_of(p: Param) -> Array:
    """Return values of a parameter within its bounds, its null among them, dense near it."""
    span = abs(p.typical - p.null)
    steps = span * np.sinh(np.linspace(-6.0, 6.0, 1201)) / 10.0
    return np.asarray(np.unique(np.clip(p.null + steps, *p.bounds)))

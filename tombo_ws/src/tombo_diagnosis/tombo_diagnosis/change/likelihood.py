"""How probable a shift of the features is under a candidate, and how far it may be off.

How far is learnt from real flights whose change is known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from tombo_diagnosis.change.signatures import (
    ADDED_WEIGHT,
    CENTRE,
    HANGING_LOAD,
    MASS,
    OTHER,
    UNBALANCE,
    WEAK_PROPELLER,
    ChangeCandidate,
)
from tombo_diagnosis.rotor_demand import MODES
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES

_SIZES: Mapping[str, tuple[float, float]] = {
    WEAK_PROPELLER: (0.1, 0.8), ADDED_WEIGHT: (0.07, 1.0), HANGING_LOAD: (0.07, 1.0),
    MASS: (0.1, 0.8), CENTRE: (0.06, 0.8),
}  # fmt: skip
"""Sizes before the data, shares of thrust, of mass and of the arm: their median, and the spread of
their logarithms. A small vehicle carries from a hundredth of its mass to half of it."""


# How far real changes are from what candidates predict: the most probable values after the ten
# conditions of CrazyPAD, vehicle E9, each log-normal before them.
_YAW_SHARE: Final = 0.38
"""Change of a rotor's torque per thrust, as a share of the thrust lost: a cut or taped blade has
another ratio."""
_WASH: Final = 0.058
"""Share of thrust, and of torque by the swirl, that a weight in its downwash may take from a
rotor, whatever its mass."""
_MISFIT: Final = 0.077
"""Share of the demand of the rotor that changes most by which a prediction may be off at each:
motors are not linear, and not alike."""
_ROUGH: Final = 0.43
"""Spread of the logarithm of shake where blades, or their air, are changed."""
_WEIGHED: Final = 0.14
"""The same with a weight near a rotor."""
_DETUNED: Final = 5.3
"""Logarithm of swing per demand: a rotor that gives less than asked for slackens the loops."""
_SWUNG: Final = 0.51
"""Spread of the logarithm of swing with a hanging load: it may calm a vehicle or shake it, as its
controller does (the simulated one swings less by 0.2 to 0.4, whatever the thread)."""
_DRAGGED: Final = 0.062
"""Trail of a hanging load [s/m], mean and spread, away from the side that it hangs on: 0.25 % of
the weight as drag at 0.3 m/s, at the end of an arm."""


def log_density(
    scale: Array, degrees: float, shift: Array, candidate: ChangeCandidate | None
) -> Array:
    """Return the log density (S,) of the shift (9,) under each size of a candidate, or under none.

    Demand is one draw of four; shake, swing and trail are draws by themselves.
    """
    demand, (mean, loose), extra = _predicted(candidate)
    gap = shift[:4] - demand
    wide = scale[:4, :4] + extra
    square = np.einsum("si,si->s", gap, np.linalg.solve(wide, gap[..., None])[..., 0])
    log = -0.5 * np.linalg.slogdet(wide)[1] - 0.5 * (degrees + 4.0) * np.log1p(square / degrees)
    for k in range(5):
        if math.isfinite(shift[4 + k]) and math.isfinite(scale[4 + k, 4 + k]):
            variance = scale[4 + k, 4 + k] + loose[:, k] ** 2
            square = (shift[4 + k] - mean[k]) ** 2 / variance
            log = log - 0.5 * np.log(variance) - 0.5 * (degrees + 1.0) * np.log1p(square / degrees)
    return np.asarray(log)


def _predicted(candidate: ChangeCandidate | None) -> tuple[Array, tuple[Array, Array], Array]:
    """Return the shift of a candidate.

    Of demand (S, 4); of shake, swing and trail the mean (5,) and standard deviation (S, 5);
    covariance of the demand that it leaves open (S, 4, 4).
    """
    if candidate is None:
        return np.zeros((1, 4)), (np.zeros(5), np.zeros((1, 5))), np.zeros((1, 4, 4))
    demand, effect = candidate.demand, candidate.effect
    largest = np.abs(demand).max(axis=1)
    mean, loose = np.zeros(5), np.zeros((len(demand), 5))
    extra = (_MISFIT * largest)[:, None, None] ** 2 * np.eye(4)
    yaw = np.outer(MODES[3], MODES[3])  # the torque of one rotor, shared by all
    if effect in (WEAK_PROPELLER, UNBALANCE, HANGING_LOAD, OTHER):
        loose[:, :2] = _ROUGH
    if effect == ADDED_WEIGHT:
        loose[:, :2] = _WEIGHED
    if effect in (WEAK_PROPELLER, ADDED_WEIGHT):
        loose[:, 2] = _DETUNED * largest
    if effect in (HANGING_LOAD, OTHER):
        loose[:, 2] = _SWUNG
    if effect == WEAK_PROPELLER:
        share = np.sum((_YAW_SHARE * candidate.sizes) ** 2, axis=1)
        extra = extra + share[:, None, None] * yaw
    if effect in (ADDED_WEIGHT, HANGING_LOAD):
        rotors = np.diag((demand[0] == demand[0].max()).astype(float))
        extra = extra + _WASH**2 * (rotors + yaw)
    if effect == HANGING_LOAD:
        k = ROTOR_NAMES.index(candidate.rotor)
        mean[3:] = _DRAGGED * np.sign([ARM_Y[k], -ARM_X[k]])
    if effect in (HANGING_LOAD, OTHER):
        loose[:, 3:] = _DRAGGED
    if effect == OTHER:
        extra = extra + candidate.sizes[:, :, None] ** 2 * np.eye(4)
    return demand, (mean, loose), extra


def size_prior(candidate: ChangeCandidate) -> Array:
    """Return the probability of each row of sizes before the data (S,)."""
    usual = _SIZES.get(candidate.effect)
    weight = candidate.volume.copy()
    if usual is not None:
        size = np.abs(candidate.sizes)
        if candidate.effect == CENTRE:
            size = np.linalg.norm(size, axis=1, keepdims=True)
            weight = weight / (size[:, 0] + 1e-6)
        size = size + 1e-6
        weight = weight * np.prod(
            np.exp(-0.5 * (np.log(size / usual[0]) / usual[1]) ** 2) / size, axis=1
        )
    return np.asarray(weight / weight.sum())

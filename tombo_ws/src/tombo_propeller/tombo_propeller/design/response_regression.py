"""Prediction of collision force, recovery time and noise of a nodus that was not measured.

Table III has one reading for each of nine soft propellers. A regression on anything that is known
of a nodus may be used only if it predicts readings that it was not fitted to better than their
mean does, by more than chance gives the best of so many regressors. Else the mean is used. Either
way the prediction interval comes from the errors on readings left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import Configuration, nodus_moduli
from tombo_propeller.design.candidates import properties

SIGNIFICANT = 0.05
FEWEST = 4
"""Readings that a prediction needs."""
MEAN = "mean"
_SHUFFLES = 4000


def flap_stiffness(configuration: Configuration) -> float:
    """Return E_N I_f / L [N m/rad]: what holds the wing against folding."""
    nodus, joint = configuration.nodus, configuration.blade.joint
    assert nodus is not None
    moment = joint.flap_second_moment_mm4 * 1e-12
    young = float(nodus_moduli(configuration).E_N_MPa) * 1e6
    return float(young * moment / (nodus.length_mm * 1e-3))


def flap_period(configuration: Configuration) -> float:
    """Return the period [s] in which the wing swings about its nodus: recovery, if it is free."""
    joint = configuration.blade.joint
    inertia = joint.wing_mass_kg * (joint.wing_centroid_m - joint.outer_radius_m) ** 2
    return 2.0 * math.pi * math.sqrt(inertia / flap_stiffness(configuration))


REGRESSORS: dict[str, Callable[[Configuration], float]] = {
    "flap stiffness": flap_stiffness,
    "root of flap stiffness": lambda c: math.sqrt(flap_stiffness(c)),  # of a blow at given speed
    "logarithm of flap stiffness": lambda c: math.log(flap_stiffness(c)),
    "flap period": flap_period,
    "share of fibres": lambda c: properties(c)["fibre_share"],
    "diameter of fibres": lambda c: c.nodus.fibre_diameter_mm if c.nodus else 0.0,
}
"""What a reading may depend on. The first is used for the rank correlation, too."""


@dataclass(frozen=True)
class RegressorScore:
    """One regressor's score: root mean square error on readings left out."""

    regressor: str
    error: float


@dataclass(frozen=True, eq=False)
class ResponseModel:
    """How one measured figure is predicted, and why so."""

    name: str
    count: int
    mean: float
    error: float
    """RMS error of the model in use, each reading left out in turn."""
    mean_error: float
    """The same of the mean."""
    trials: tuple[RegressorScore, ...]
    """All regressors, best first."""
    chance: float
    """Probability that the best of them does as well against the mean on shuffled readings."""
    rank_correlation: float
    """Spearman's, with flap stiffness."""
    rank_p_value: float
    regressor: str
    """What is used; MEAN if no regressor is accepted."""
    coefficients: tuple[float, ...]
    points: Array
    """(n,) the regressor at the readings; empty for the mean."""

    @property
    def parameters(self) -> int:
        """Number of fitted coefficients."""
        return len(self.coefficients)

    def predict(self, configuration: Configuration) -> tuple[float, float]:
        """Return the prediction for a nodus, and its standard error as a prediction."""
        if self.count < FEWEST:
            return math.nan, math.nan
        if self.regressor == MEAN:
            return self.mean, self.error
        x = REGRESSORS[self.regressor](configuration)
        centre = float(self.points.mean())
        spread = float(((self.points - centre) ** 2).sum())
        leverage = 1.0 / self.count + (x - centre) ** 2 / spread
        usual = self.parameters / self.count
        value = self.coefficients[0] + self.coefficients[1] * x
        return value, self.error * math.sqrt((1.0 + leverage) / (1.0 + usual))

    def quantile(self, probability: float) -> float:
        """Return Student's quantile for the degrees of freedom that are left."""
        if self.count < FEWEST:
            return math.nan
        return float(stats.t.ppf(probability, self.count - self.parameters))


def left_out_errors(design: Array, values: Array) -> Array:
    """Return each value minus its prediction by least squares on all others.

    Args:
        design: (n, p) regressors, a column of ones included.
        values: (n,) or (n, m) for m sets of values.
    """
    hat = design @ np.linalg.pinv(design)
    left = 1.0 - np.diag(hat)
    return np.asarray((values - hat @ values) / (left if values.ndim == 1 else left[:, None]))


def read(name: str, measured: Sequence[Configuration]) -> ResponseModel:
    """Choose how to predict a figure, from the soft propellers that have a reading of it.

    Args:
        name: `collision_force_N`, `recovery_s` or `noise_dB`.
        measured: configurations; those that are rigid or have no such reading are left out.
    """
    known = [c for c in measured if c.nodus and c.measured and _value(c, name) is not None]
    values = np.array([_value(c, name) for c in known], dtype=float)
    count = values.size
    if count < FEWEST:
        mean = float(values.mean()) if count else math.nan
        nan = math.nan
        return ResponseModel(
            name, count, mean, nan, nan, (), nan, nan, nan, MEAN, (mean,), np.empty(0)
        )
    ones = np.ones((count, 1))
    shuffled = _shuffles(values)
    mean_errors = _rms(left_out_errors(ones, shuffled))
    errors: dict[str, Array] = {}
    at: dict[str, Array] = {}
    for regressor, of in REGRESSORS.items():
        x = np.array([of(c) for c in known])
        scale = float(np.ptp(x))
        if not scale > 1e-9 * abs(float(x.mean())):
            continue
        if np.unique(np.round((x - x.min()) / scale, 9)).size < 3:
            continue  # a point alone at its place can't be left out of a straight line
        at[regressor] = x
        errors[regressor] = _rms(left_out_errors(np.column_stack([ones, x]), shuffled))
    trials = sorted(
        (RegressorScore(r, float(e[0])) for r, e in errors.items()), key=lambda t: t.error
    )
    best_gain = (
        np.max([mean_errors - e for e in errors.values()], axis=0) if errors else -mean_errors
    )
    chance = float((best_gain >= best_gain[0] - 1e-12).mean())
    stiffness = [flap_stiffness(c) for c in known]
    rank = stats.spearmanr(stiffness, values) if errors and np.ptp(values) > 0.0 else None
    regressor, error = MEAN, float(mean_errors[0])
    coefficients: tuple[float, ...] = (float(values.mean()),)
    points: Array = np.empty(0)
    if trials and trials[0].error < mean_errors[0] and chance < SIGNIFICANT:
        regressor, error = trials[0].regressor, trials[0].error
        points = at[regressor]
        fit = np.linalg.lstsq(np.column_stack([ones, points]), values, rcond=None)[0]
        coefficients = (float(fit[0]), float(fit[1]))
    return ResponseModel(
        name=name,
        count=count,
        mean=float(values.mean()),
        error=error,
        mean_error=float(mean_errors[0]),
        trials=tuple(trials),
        chance=chance,
        rank_correlation=float(rank.statistic) if rank is not None else math.nan,
        rank_p_value=float(rank.pvalue) if rank is not None else math.nan,
        regressor=regressor,
        coefficients=coefficients,
        points=points,
    )


def _value(configuration: Configuration, name: str) -> float | None:
    value: float | None = getattr(configuration.measured, name, None)
    return value


def _rms(errors: Array) -> Array:
    return np.asarray(np.sqrt((errors**2).mean(axis=0)))


def _shuffles(values: Array) -> Array:
    """Return (n, 1 + _SHUFFLES): the values, then the values in random orders."""
    rng = np.random.default_rng(0)
    orders = rng.permuted(np.tile(np.arange(values.size), (_SHUFFLES, 1)), axis=1)
    return np.column_stack([values, values[orders].T])

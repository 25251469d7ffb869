"""Gusts: random air, seen as force that no motion repeats and that fades with its own time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.parameters import PARAMETERS
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.residual_check import ScaleVariances, noise_variances
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import layout

_TIMES = np.array([0.15, 0.3, 0.5, 0.8, 1.2, 2.0, 3.5, 7.0])
_LONGEST = 3.0
"""s: a force that holds for longer while the vehicle moves on is one of place, not of air."""
_TIME_TOLERANCE = 0.3
"""Healthy scatter of the logarithm of the gusts' time."""
_FORCES = ("force", "acceleration")
_DEVIATIONS = np.geomspace(0.05, 4.0, 120)
"""m/s"""
_MODEL_LOG_SD = 0.1
"""Healthy scatter of the logarithm of a power beyond sampling."""


@dataclass(frozen=True)
class GustFit:
    """Gusts fitted to the powers of the forces."""

    deviation: float
    time: float
    deviation_error: float
    time_error: float
    evidence: float
    """Log Bayes factor against the nominal model's own gusts."""
    theta: Array
    """The theta that was given, with these gusts."""
    at_edge: bool
    """Time or deviation are what no gusts have: what was fitted is something else."""


def fit_gusts(problem: FlightProblem, fit: Fit, measured: ScaleVariances) -> GustFit:
    """Fit deviation and time of the gusts to what a fit leaves of the forces, `measured`."""
    places = layout()["gusts"]
    forces = [j for j, n in enumerate(measured.names) if n.startswith(_FORCES)]
    values = measured.variances[:, forces]
    error = np.sqrt(4.0 / np.maximum(measured.counts[:, forces], 1.0) + _MODEL_LOG_SD**2)
    usable = np.isfinite(values)

    def cost(model: Array) -> float:
        # Powers scatter as their number of blocks says; a logarithm makes that even.
        miss = (np.log(np.maximum(values, 1e-12)) - np.log(model + 1e-6)) / error
        return 0.5 * float(np.sum(miss[usable] ** 2))

    theta_without_gusts = fit.theta.copy()
    theta_without_gusts[places["deviation"]] = 0.0
    noise_only = noise_variances(problem, theta_without_gusts).variances[:, forces]
    costs, tried = [], []
    for time in _TIMES:
        theta_with_gusts = theta_without_gusts.copy()
        theta_with_gusts[places["deviation"]] = 1.0
        theta_with_gusts[places["time"]] = time
        # Force is linear in small gusts: powers add, and grow with the square of the deviation.
        unit = np.maximum(
            noise_variances(problem, theta_with_gusts).variances[:, forces] - noise_only, 0.0
        )
        for deviation in _DEVIATIONS:
            costs.append(cost(noise_only + deviation**2 * unit))
            tried.append((deviation, time))
    grid = np.array(tried)
    likelihood = np.exp(np.min(costs) - np.array(costs))
    weights = likelihood / likelihood.sum()
    points = np.log(grid)
    mean = weights @ points
    spread = np.sqrt(np.maximum(weights @ (points - mean) ** 2, 1e-6))
    deviation, time = (float(v) for v in np.exp(mean))
    theta = fit.theta.copy()
    theta[places["deviation"]], theta[places["time"]] = deviation, time
    own = next(p for p in PARAMETERS if p.index == places["deviation"])
    off = (grid[:, 0] - problem.theta[own.index]) / own.tolerance
    slow = np.log(grid[:, 1] / problem.theta[places["time"]]) / _TIME_TOLERANCE
    healthy = np.exp(-0.5 * (off**2 + slow**2)) * grid[:, 0]
    healthy /= healthy.sum()
    evidence = math.log(max(float(likelihood.mean()), 1e-300))
    evidence -= math.log(max(float(likelihood @ healthy), 1e-300))
    return GustFit(
        deviation, time, deviation * float(spread[0]), time * float(spread[1]), evidence, theta,
        not _TIMES[0] * 1.2 < time < _LONGEST or deviation > _DEVIATIONS[-1] / 1.2,
    )  # fmt: skip

"""Analysis of operating points: the engine's search, and the test against unknown causes.

The test asks whether free curves over speed still explain something. A curve is added to an
explanation, in one channel: one for all propellers, one for each, one for the way up against the
way down, or a level and a slope for each run; or all of these at once. Which one is right is not
known, so their evidence is averaged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.engine.model import Analysis, Remainder, SearchResult
from tombo_diagnosis.engine.regression import Fit, NormalEquations, solve
from tombo_diagnosis.engine.verdict import analyse_problem
from tombo_diagnosis.stand.problem import RUN, SHARE, StandProblem
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import CHANNELS, Setup
from tombo_flight.progress import no_progress

_ORDER = 10
_ORDER_DECAY = 0.88
"""Each higher order of a curve is this much smaller."""
_RUN_ORDER = 1
"""Of a run's own curve: what differs from run to run is a level or a share."""
_MIN_SPEEDS = 4
"""Different speeds that a curve needs."""
_PRIOR_WIDTHS = (0.003, 0.01, 0.03, 0.1)
"""Of a curve, in shares of the channel's range."""


@dataclass(frozen=True)
class ResidualCurves:
    """Free curves that are added to an explanation."""

    evidence: float
    """Log Bayes factor of the curves against none."""
    channel: str
    """Where most of it lies."""
    size: float
    """RMS of the curves in that channel, in its unit."""


def fit_residual_curves(problem: StandProblem, fit: Fit, by_run: bool = True) -> ResidualCurves:
    """Return the evidence of free curves added to a fit; `by_run`: also levels of runs."""
    blocks = _blocks(problem, by_run and problem.repeated)
    if not blocks:
        return ResidualCurves(-math.inf, "", 0.0)
    moved = fit.free or problem.unknowns.absorbed
    slopes = problem.slopes_at(fit.theta) if moved else problem.slopes
    left = problem.residual(fit.theta)
    basis = np.concatenate([columns for columns, _ in blocks], axis=2)
    every = np.concatenate([slopes, problem.drawn, basis], axis=2)
    normal, _ = problem.whitened(left, every, fit.prior_std_scale)
    known = problem.unknowns.deviations(fit.free, fit.prior_std_scale)
    prior_mean = fit.prior_mean
    without = solve(
        _part(normal, np.arange(known.size)), known, prior_mean, covariance=False
    ).evidence
    tried: list[tuple[float, Array, Array]] = []
    ends = known.size + np.cumsum([0, *(orders.size for _, orders in blocks)])
    orders = np.concatenate([block_orders for _, block_orders in blocks])
    choices = [[k] for k in range(len(blocks))] + [list(range(len(blocks)))]
    for choice in choices:
        places = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in choice])
        part = _part(normal, np.concatenate([np.arange(known.size), places]))
        unit = _ORDER_DECAY ** orders[places - known.size]
        for size in _PRIOR_WIDTHS:
            solution = solve(
                part,
                np.concatenate([known, size * unit]),
                np.concatenate([prior_mean, np.zeros(places.size)]),
                covariance=False,
            )
            gain = solution.evidence - without
            tried.append((gain, places - known.size, solution.mean[known.size :]))
    gains = np.array([gain for gain, _, _ in tried])
    _, chosen, mean = tried[int(np.argmax(gains))]
    curve = basis[:, :, chosen] @ mean
    weights = np.sum((curve / problem.sigma) ** 2, axis=0)
    worst = int(np.argmax(weights))
    rows = problem.seen[:, worst]
    size = float(np.sqrt(np.mean(curve[rows, worst] ** 2))) if rows.any() else 0.0
    evidence = float(np.logaddexp.reduce(gains)) - math.log(len(gains))
    return ResidualCurves(evidence, CHANNELS[worst], size)


def _part(normal: NormalEquations, places: NDArray[np.int64]) -> NormalEquations:
    return NormalEquations(
        normal.matrix[np.ix_(places, places)], normal.vector[places], normal.square
    )


def _blocks(problem: StandProblem, by_run: bool) -> list[tuple[Array, NDArray[np.int64]]]:
    """Return free curves in units of their channel's range (N, 4, B), and their orders (B,)."""
    setup = problem.points.setup
    n = setup.speed.size
    x = 2.0 * setup.speed / max(float(setup.speed.max()), 1e-9) - 1.0
    different = np.unique(np.round(50.0 * x)).size
    if different < _MIN_SPEEDS:
        return []  # a curve over speed needs speeds
    order = min(_ORDER, different - 2)
    legendre = np.zeros((n, _ORDER + 1))
    legendre[:, : order + 1] = np.polynomial.legendre.legvander(x, order)
    groups: list[tuple[list[Array], int]] = [
        ([np.ones(n)], _ORDER),
        ([_run_direction(setup)], _ORDER),
    ]
    if problem.propellers > 1:
        groups.append((_members(setup.propeller, problem.propellers), _ORDER))
    if by_run:
        groups.append((_members(setup.run, problem.runs), _RUN_ORDER))
    blocks: list[tuple[Array, NDArray[np.int64]]] = []
    for c in problem.points.measured:
        rows = problem.seen[:, c]
        if rows.sum() < 3:
            continue
        largest = float(np.max(np.abs(problem.points.readings[rows, c])))
        for group, highest in groups:
            own_orders = np.tile(np.arange(highest + 1), len(group))
            block = np.zeros((n, len(CHANNELS), own_orders.size))
            block[:, c, :] = np.concatenate(
                [largest * legendre[:, : highest + 1] * g[:, None] for g in group], axis=1
            )
            blocks.append((block, own_orders))
    return blocks


def _members(number: NDArray[np.int64], count: int) -> list[Array]:
    return [(number == k).astype(float) for k in range(count)]


def _run_direction(setup: Setup) -> Array:
    """Return -1 up to the highest speed of each run and 1 after it."""
    way = np.full(setup.speed.size, -1.0)
    for run in np.unique(setup.run):
        rows = np.flatnonzero(setup.run == run)
        top = rows[int(np.argmax(setup.speed[rows]))]
        way[rows[setup.elapsed[rows] > setup.elapsed[top]]] = 1.0
    return way


LOG_BF_CURVES = 3.0
"""Log Bayes factor above which free curves show that something is unexplained."""
_MIN_PARTIAL_SHARE = 0.7
"""Least share of the explained evidence for a cause that is called part of it."""
_LOG_BF_OVER_CURVES, _LOG_BF_OVER_CURVES_EACH = 4.0, 6.0
"""Log Bayes factor by which a cause, and each further one, has to beat free curves alone: names
say more than a shape only if they say it with less."""


@dataclass(frozen=True, kw_only=True)
class StandRemainder(Remainder):
    """Remainder of stand runs: what free curves over speed still explain."""

    curves: ResidualCurves
    """Beside the causes."""
    curves_without_causes: ResidualCurves


StandAnalysis = Analysis[StandProblem, StandRemainder]


def analyse(
    points: OperatingPoints,
    absorbed: Sequence[str] = (),
    base: Mapping[str, tuple[float, ...]] | None = None,
) -> StandAnalysis:
    """Diagnose operating points.

    Args:
        points: the measurements.
        absorbed: effects that the nominal model's own fit to these points has absorbed.
        base: parameters of the nominal model that are not at their null value.

    Raises:
        InputError: no point is within the model's valid speeds.
    """
    problem = StandProblem(points, absorbed, dict(base or {}))
    return analyse_problem(problem, check_residual, no_progress)


def check_residual(problem: StandProblem, result: SearchResult) -> StandRemainder:
    """Return the remainder of the best explanation, tested with free curves over speed."""
    best = result.best
    curves = fit_residual_curves(problem, best.fit)
    alone = curves
    ahead = -math.inf
    if best.hypotheses:
        # A level for each run is what these stochastic effects are: no rival of theirs.
        by_run = not {RUN, SHARE} & set(best.effects)
        alone = fit_residual_curves(problem, problem.null_hypothesis, by_run=by_run)
        ahead = _LOG_BF_OVER_CURVES + _LOG_BF_OVER_CURVES_EACH * (len(best.hypotheses) - 1)
    over = min(max(curves.evidence - LOG_BF_CURVES, -50.0), 50.0)
    return StandRemainder(
        clean=curves.evidence < LOG_BF_CURVES and best.evidence > alone.evidence + ahead,
        p_unexplained=1.0 / (1.0 + math.exp(-over)),
        mostly_explained=best.evidence > _MIN_PARTIAL_SHARE * (best.evidence + curves.evidence),
        curves=curves,
        curves_without_causes=alone,
    )

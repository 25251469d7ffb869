"""Analysis of operating points: the engine's search, and the test with free curves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tombo_diagnosis.engine.model import Findings, Remainder, SearchResult
from tombo_diagnosis.engine.verdict import analyse_problem
from tombo_diagnosis.stand.problem import RUN, SHARE, StandProblem
from tombo_diagnosis.stand.residual_check import ResidualCurves, fit_residual_curves
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_flight.progress import no_progress

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


StandFindings = Findings[StandProblem, StandRemainder]


def analyse(
    points: OperatingPoints,
    absorbed: Sequence[str] = (),
    base: Mapping[str, tuple[float, ...]] | None = None,
) -> StandFindings:
    """Diagnose operating points.

    Args:
        points: what was measured.
        absorbed: effects that the nominal model's own fit to these points has absorbed.
        base: parameters of the nominal model that are not at their null value.

    Raises:
        InputError: no point is within the model's valid speeds.
    """
    problem = StandProblem(points, absorbed, dict(base or {}))
    return analyse_problem(problem, check_residual, no_progress)


def check_residual(problem: StandProblem, found: SearchResult) -> StandRemainder:
    """Return the remainder of the best explanation, tested with free curves over speed."""
    best = found.best
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

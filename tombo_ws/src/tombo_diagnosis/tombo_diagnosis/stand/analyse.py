"""From operating points to what is wrong: regression, search, verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tombo_diagnosis.stand.model_selection import SearchResult, search
from tombo_diagnosis.stand.operating_points import OperatingPoints
from tombo_diagnosis.stand.problem import Problem
from tombo_diagnosis.stand.verdict import Judgement, judge


@dataclass(frozen=True, eq=False)
class Findings:
    """All that the analysis came to."""

    problem: Problem
    search: SearchResult
    judgement: Judgement


def analyse(
    points: OperatingPoints,
    absorbed: Sequence[str] = (),
    base: Mapping[str, tuple[float, ...]] | None = None,
) -> Findings:
    """Diagnose operating points.

    Args:
        points: what was measured.
        absorbed: effects that the nominal model's own fit to these points has taken up.
        base: parameters of the nominal model that are not at their null value.

    Raises:
        InputError: no point is within the model's valid speeds.
    """
    problem = Problem(points, absorbed, dict(base or {}))
    found = search(problem)
    return Findings(problem, found, judge(problem, found))

"""The whole analysis, in order: search for causes, look at what is left, judge."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from tombo_diagnosis.engine.model import Findings, Model, Remainder, SearchResult
from tombo_diagnosis.engine.model_selection import search
from tombo_diagnosis.engine.verdict import judge
from tombo_flight.progress import ProgressCallback

P = TypeVar("P", bound=Model)
R = TypeVar("R", bound=Remainder)


def analyse_problem(
    problem: P, test_residual: Callable[[P, SearchResult], R], progress: ProgressCallback
) -> Findings[P, R]:
    """Select the causes.

    `test_residual` compares the residual of the best explanation with noise; `progress` is called
    with a stage and the share done, from 0.3 on.
    """
    progress("selecting causes", 0.3)
    found = search(problem, lambda share: progress("selecting causes", 0.3 + 0.3 * share))
    progress("testing the residual", 0.6)
    remainder = test_residual(problem, found)
    return Findings(problem, found, remainder, judge(problem.setting, found, remainder))

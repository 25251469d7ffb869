"""One synthetic stand case from hiding to score."""

from __future__ import annotations

import time
from typing import Any

from tombo_benchmarks.diagnosis.evaluation import (
    answer_row,
    case_row,
    compare_parameters,
    exactly_right,
)
from tombo_benchmarks.diagnosis.stand_cases import make_case
from tombo_diagnosis.engine.regression import FreeParameter
from tombo_diagnosis.stand.analyse import analyse
from tombo_diagnosis.stand.causes import estimate_cause
from tombo_dynamics.propeller.effects import STAND_EFFECTS


def examine(seed: int, number: int) -> dict[str, Any]:
    """Hide and diagnose one case, and return its score as plain values."""
    case = make_case(seed, number)
    began = time.perf_counter()
    findings = analyse(case.points)
    row = case_row(case) | answer_row(findings, time.perf_counter() - began)
    row["left"] = findings.remainder.curves.evidence
    row["free"] = findings.remainder.curves_without_causes.evidence
    if exactly_right(case, findings):

        def true_value(p: FreeParameter, nominal: float) -> float:
            return nominal + case.shift.get(p.label, 0.0)

        causes = [
            estimate_cause(e, findings) for e in case.hidden if not STAND_EFFECTS[e].stochastic
        ]
        row["parameters"] = {
            c.effect: compare_parameters(case, findings.problem, c, true_value) for c in causes
        }
    return row

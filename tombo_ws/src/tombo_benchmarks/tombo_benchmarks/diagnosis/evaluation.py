"""Result of a synthetic case as plain values, the same for flights and stands."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from tombo_benchmarks.diagnosis.cases import Case
from tombo_diagnosis.diagnosis import Cause
from tombo_diagnosis.engine.model import Analysis, RegressionModel
from tombo_diagnosis.engine.regression import FreeParameter

_RIVALS = 3
"""Number of other explanations that are reported."""


def case_row(case: Case) -> dict[str, Any]:
    """Return the facts of a case before it is diagnosed."""
    return {
        "case": case.number,
        "kind": case.kind,
        "size": case.size,
        "formulation": case.formulation,
        "hidden": list(case.hidden),
        "shift": dict(case.shift),
    }


def answer_row(findings: Analysis[Any, Any], seconds: float) -> dict[str, Any]:
    """Return the answer, and the evidence of its verdict."""
    judgement, found = findings.judgement, findings.search
    return {
        "verdict": judgement.verdict,
        "causes": list(judgement.effects),
        "set": list(judgement.members),
        "confidence": judgement.confidence,
        "seconds": seconds,
        "evidence": found.best.evidence,
        "rivals": [
            {"effects": list(r.effects), "evidence": r.evidence, "disputed": disputed}
            for r in found.alternatives[:_RIVALS]
            if math.isfinite(disputed := found.log_bf_of_difference(r))
            and math.isfinite(r.evidence)
        ],
        "lead": max(found.single_log_bf.values(), default=0.0),
    }


def exactly_right(case: Case, findings: Analysis[Any, Any]) -> bool:
    """Return whether just what is hidden was named."""
    judgement = findings.judgement
    named = judgement.verdict == "named" and not judgement.members
    return named and set(judgement.effects) == set(case.hidden)


def compare_parameters(
    case: Case,
    problem: RegressionModel,
    cause: Cause,
    true_value: Callable[[FreeParameter, float], float],
) -> dict[str, Any]:
    """Return the relative error of a cause's change, and which intervals cover the truth.

    `true_value` gives a parameter's value in the model that made the data, from its value in the
    model that they were compared with.
    """
    off = size = 0.0
    covered = []
    fitted = {f.name: f for f in cause.theta}
    for p in problem.unknowns.parameters:
        if p.effect != cause.effect:
            continue
        found, nominal = fitted.get(p.name), float(problem.theta[p.index])
        value, true = nominal if found is None else found.value, true_value(p, nominal)
        off += ((value - true) / p.scale) ** 2
        size += ((true - nominal) / p.scale) ** 2
        if found is not None and p.label in case.shift:
            covered.append(bool(found.low <= true <= found.high))
    return {"error": math.sqrt(off / size) if size else None, "covered": covered}

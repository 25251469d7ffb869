"""One blind stand case from hiding to score."""

from __future__ import annotations

import math
import time
from typing import Any

from tombo_diagnosis.benchmark.stand_cases import Case, make_case
from tombo_diagnosis.stand.analyse import StandFindings, analyse
from tombo_diagnosis.stand.cause_estimates import fitted
from tombo_dynamics.propeller.effects import STAND_EFFECTS


def examine(seed: int, number: int) -> dict[str, Any]:
    """Hide and diagnose one case, and return its score as plain values."""
    case = make_case(seed, number)
    began = time.perf_counter()
    findings = analyse(case.points)
    seconds = time.perf_counter() - began
    judgement, best = findings.judgement, findings.search.best
    row: dict[str, Any] = {
        "case": number,
        "kind": case.kind,
        "size": case.size,
        "formulation": case.stand,
        "hidden": list(case.hidden),
        "shift": dict(case.shift),
        "verdict": judgement.verdict,
        "causes": list(judgement.effects),
        "set": list(judgement.members),
        "confidence": judgement.confidence,
        "seconds": seconds,
        "evidence": best.evidence,
        "left": findings.remainder.curves.evidence,
        "free": findings.remainder.curves_without_causes.evidence,
    }
    right = judgement.verdict == "named" and not judgement.members
    if right and set(judgement.effects) == set(case.hidden):
        row["parameters"] = {
            e: _compared(case, findings, e)
            for e in judgement.effects
            if not STAND_EFFECTS[e].stochastic
        }
    return row


def _compared(case: Case, findings: StandFindings, effect: str) -> dict[str, Any]:
    """Return the relative error of an effect's change, and which intervals cover the truth."""
    off = size = 0.0
    covered = []
    scales = {p.label: p.scale for p in findings.problem.columns.parameters}
    for found in fitted(findings.problem, findings.search.best, effect)[0]:
        label = f"{effect}.{found.name}"
        change = case.shift.get(label, 0.0)
        true = found.nominal + change
        off += ((found.value - true) / scales[label]) ** 2
        size += (change / scales[label]) ** 2
        covered.append(bool(found.low <= true <= found.high))
    return {"error": math.sqrt(off / size) if size else None, "covered": covered}

"""One blind case from hiding to score: fly, diagnose, compare with what was hidden."""

from __future__ import annotations

import math
import time
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.benchmark.flight_cases import Case, make_case
from tombo_diagnosis.benchmark.flight_simulation import (
    benchmark_nominal,
    simulate_case,
    true_draws,
)
from tombo_diagnosis.checks import check_log
from tombo_diagnosis.diagnosis import Cause
from tombo_diagnosis.engine.model_selection import restrict_to
from tombo_diagnosis.flight.analyse import FlightFindings, analyse
from tombo_diagnosis.flight.cause_estimates import estimate_cause
from tombo_diagnosis.flight.cross_validation import fit_without_flight
from tombo_diagnosis.flight.diagnose import final_explanation
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.flight.prediction import residuals
from tombo_diagnosis.flight.track import track_of
from tombo_dynamics.errors import InputError

Array = NDArray[np.float64]

STOCHASTIC_EFFECTS = frozenset(
    {"gusts", "imu_noise", "mocap_noise", "mocap_dropouts", "thrust_scatter"}
)
"""Effects without a mean: how well they can be fitted, the number of samples says."""

_RIVALS = 3
"""So many of the other explanations are reported."""


@lru_cache(maxsize=1)
def _nominal() -> NominalModel:
    return benchmark_nominal()


def examine(seed: int, number: int) -> dict[str, Any]:
    """Fly and diagnose one case, and return its score as plain values."""
    case = make_case(seed, number)
    row: dict[str, Any] = {
        "case": number,
        "kind": case.kind,
        "size": case.size,
        "formulation": case.formulation,
        "hidden": list(case.hidden),
        "shift": dict(case.shift),
    }
    try:
        tracks = [track_of(check_log(log)) for log in simulate_case(case)]
    except InputError as error:
        # What is hidden can keep the vehicle from flying at all: that needs no diagnosis.
        return row | {"verdict": "not flown", "why": str(error)}
    began = time.perf_counter()
    findings = analyse(tracks, _nominal())
    seconds = time.perf_counter() - began
    judgement = findings.judgement
    best = findings.search.best
    causes = {e: estimate_cause(e, findings, best) for e in judgement.effects if e in case.hidden}
    row |= {
        "verdict": judgement.verdict,
        "causes": list(judgement.effects),
        "set": list(judgement.members),
        "confidence": judgement.confidence,
        "seconds": seconds,
        "evidence": best.evidence,
        "excess": max((each.excess for each in findings.remainder.residual_excesses), default=0.0),
        "repeats": findings.remainder.residual_r2,
        "explained": judgement.explained,
        "rivals": [
            {"effects": list(r.effects), "evidence": r.evidence, "disputed": log_bf_of_difference}
            for r in findings.search.alternatives[:_RIVALS]
            if math.isfinite(log_bf_of_difference := findings.search.log_bf_of_difference(r))
            and math.isfinite(r.evidence)
        ],
        "lead": max(findings.search.single_log_bf.values(), default=0.0),
        "chance": max((fit.evidence for fit in findings.remainder.all_noise_fits), default=0.0),
    }
    right = judgement.verdict == "named" and not judgement.members
    if right and set(judgement.effects) == set(case.hidden):
        row["parameters"] = {e: _compared(case, cause) for e, cause in causes.items()}
        row["gain_share"] = _gain_share(case, findings)
    return row


def _compared(case: Case, cause: Cause) -> dict[str, Any]:
    """Return the relative error of an effect's change, and which intervals cover the truth."""
    off = size = 0.0
    covered = []
    parameters = {p.name: p for p in _nominal().parameters if p.effect == cause.effect}
    fitted = {f.name: f for f in cause.theta}
    for name, p in parameters.items():
        nominal = float(_nominal().theta[p.index])
        # What tolerances put on an axis that was not shifted is there to be measured, too.
        true = float(case.effects.get(cause.effect, {}).get(name, nominal))
        change = true - nominal
        value = fitted[name].value if name in fitted else nominal
        off += ((value - true) / p.scale) ** 2
        size += (change / p.scale) ** 2
        if name in fitted and p.label in case.shift:
            covered.append(bool(fitted[name].low <= true <= fitted[name].high))
    return {"error": math.sqrt(off / size) if size else None, "covered": covered}


def _gain_share(case: Case, findings: FlightFindings) -> float | None:
    """Return what the extension removes of what the true model removes, in held-out flights."""
    problem = findings.problem
    final = final_explanation(findings)
    if not final.hypotheses:
        return None
    tried = [
        final,
        *(restrict_to(problem, final, (e,)) for e in final.effects if len(final.hypotheses) > 1),
    ]
    theta = problem.theta.copy()
    for p in _nominal().parameters:
        theta[p.index] += case.shift.get(p.label, 0.0)
    draws = true_draws(case) if "thrust_scatter" in case.hidden else np.zeros(8)
    removed = possible = 0.0
    for f, track in enumerate(problem.tracks):
        held = fit_without_flight(problem, f, tried)
        true = residuals(track, problem.nominal, theta, draws=draws)
        for group, before in problem.linears[f].residual.items():
            weight = 1.0 / problem.variances[f][group]
            removed += float(weight @ np.sum(before**2 - held.residual[group] ** 2, axis=0))
            possible += float(weight @ np.sum(before**2 - true[group] ** 2, axis=0))
    return removed / possible if possible > 25.0 else None

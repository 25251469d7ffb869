"""One synthetic case from hiding to score: fly, diagnose, compare with the hidden effects."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tombo_benchmarks.diagnosis.evaluation import (
    answer_row,
    case_row,
    compare_parameters,
    exactly_right,
)
from tombo_benchmarks.diagnosis.flight_cases import NOMINAL_MODEL, FlightCase, make_case
from tombo_benchmarks.diagnosis.flight_simulation import fly_case
from tombo_diagnosis.flight.analyse import FlightAnalysis
from tombo_diagnosis.flight.causes import estimate_cause
from tombo_diagnosis.flight.diagnose import diagnose_unchecked
from tombo_dynamics.errors import InputError
from tombo_logs.readers.log_reader import read_logs


def examine(seed: int, number: int, **shorter: Any) -> dict[str, Any]:
    """Fly and record one case, diagnose the files, and return its score as plain values.

    `shorter`: fewer flights, or a shorter course, as of `make_case`.
    """
    case = make_case(seed, number, **shorter)
    row = case_row(case)
    with TemporaryDirectory(prefix="tombo-benchmark-") as folder:
        try:
            files = fly_case(case, Path(folder))
            diagnosis, findings = diagnose_unchecked(
                read_logs(files), NOMINAL_MODEL, clock=time.perf_counter
            )
        except InputError as error:
            # A hidden effect can keep the vehicle from flying at all: that needs no diagnosis.
            return row | {"verdict": "not flown", "why": str(error)}
    remainder = findings.remainder
    row |= answer_row(findings, diagnosis.seconds) | {
        "excess": max((each.excess for each in remainder.residual_excesses), default=0.0),
        "repeats": remainder.residual_r2,
        "chance": max((fit.evidence for fit in remainder.all_noise_fits), default=0.0),
    }
    if exactly_right(case, findings):
        row["parameters"] = {e: _compared(case, findings, e) for e in case.hidden}
    return row


def _compared(case: FlightCase, findings: FlightAnalysis, effect: str) -> dict[str, Any]:
    """Return how well an effect's parameters were found.

    What tolerances put on an axis that was not shifted is there to be measured, too.
    """
    cause = estimate_cause(effect, findings, findings.search.best)
    made = case.effects.get(effect, {})
    return compare_parameters(
        case, findings.problem, cause, lambda p, nominal: float(made.get(p.name, nominal))
    )

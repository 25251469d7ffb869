"""Flights of a simulator by others with their truth, diagnosed and scored.

`other_environments/rotorpy_flights.py` writes such folders. Each has flight_*.csv, mapping.yaml,
vehicle.yaml, and truth.json: {"condition": a name, "truth": {"effect.parameter": true value}}.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from tombo_benchmarks.diagnosis.runner import BenchmarkResult, Row
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.diagnose import diagnose_unchecked
from tombo_diagnosis.flight.nominal import held_against, nominal_model
from tombo_dynamics.errors import InputError, shown
from tombo_flight.report.page import Table
from tombo_flight.vehicle_file import read_vehicle
from tombo_logs.readers.log_reader import read_logs

TRUTH: Final = "truth.json"
_FORM: Final = '{"condition": "mass", "truth": {"mass_error.fraction": 0.1}}'


def cases_in(folder: Path) -> list[Path]:
    """Return the folders of the cases, in the order of their names.

    Raises:
        InputError: there is none.
    """
    cases = sorted(path.parent for path in folder.glob(f"*/{TRUTH}"))
    if not cases:
        raise InputError(
            f"'{folder}': no case; accepted: a folder that rotorpy_flights.py has written, with "
            f"*/{TRUTH}"
        )
    return cases


def examine(cases: Sequence[Path], seed: int, number: int) -> Row:
    """Diagnose the flights of a case; return the answer and the truth."""
    case = cases[number]
    condition, truth = _truth_of(case / TRUTH)
    row = {"case": case.name, "condition": condition, "truth": truth}
    try:
        flights = read_logs(sorted(case.glob("flight_*.csv*")), mapping=case / "mapping.yaml")
        vehicle = read_vehicle(str(case / "vehicle.yaml"))
        nominal = nominal_model(vehicle=vehicle)
        found = diagnose_unchecked(held_against(flights, vehicle), nominal)[0]
    except InputError as error:
        return row | {"answer": "withheld", "verdict": "refused", "summary": str(error)}
    fitted = {f"{c.effect}.{f.name}": f for c in found.causes for f in c.theta}
    return row | {
        "answer": answer_of(found, {label.split(".")[0] for label in truth}),
        "verdict": found.verdict,
        "set": list(found.set),
        "confidence": found.confidence,
        "found": {label: f.value for label, f in fitted.items()},
        "covered": [
            bool(fitted[label].low <= value <= fitted[label].high)
            for label, value in truth.items()
            if label in fitted
        ],
        "summary": found.summary,
        "seconds": found.seconds,
    }


def answer_of(found: Diagnosis, hidden: set[str]) -> str:
    """Return `right` (just what is hidden), `in a set`, `wrong` or `withheld` (no name)."""
    named = {cause.effect for cause in found.causes}
    if found.verdict in ("none", "unknown"):
        return "right" if found.verdict == "none" and not hidden else "withheld"
    if named == hidden and not found.set:
        return "right"
    return "in a set" if hidden & {*named, *found.set} else "wrong"


def _truth_of(path: Path) -> tuple[str, dict[str, float]]:
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
        return str(said["condition"]), {str(k): float(v) for k, v in said["truth"].items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"'{path}': {shown(str(error))}; accepted: {_FORM}") from error


def aggregate(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of all flights, and of each condition."""
    conditions = dict.fromkeys(row["condition"] for row in rows)
    parts = {name: _score([r for r in rows if r["condition"] == name]) for name in conditions}
    return _score(rows) | {"conditions": parts}


def _score(rows: Sequence[Row]) -> dict[str, Any]:
    answers = [row["answer"] for row in rows]
    covered = [one for row in rows for one in row.get("covered", [])]
    stated = [row["confidence"] for row in rows if "confidence" in row]
    return {
        "cases": len(rows),
        **{name: answers.count(name) for name in ("right", "in a set", "wrong", "withheld")},
        "stated": float(np.mean(stated)) if stated else None,
        "coverage_95": float(np.mean(covered)) if covered else None,
    }


def score_table(result: BenchmarkResult) -> Table:
    """Return the score of all flights and of each condition as a table."""
    rows = []
    for name, part in [("all", result.aggregate), *result.aggregate["conditions"].items()]:
        shares = [part[key] for key in ("stated", "coverage_95")]
        counts = (part[key] for key in ("cases", "right", "in a set", "wrong", "withheld"))
        told = ("–" if share is None else f"{100.0 * share:.0f} %" for share in shares)
        rows.append((name, *map(str, counts), *told))
    head = ("hidden", "cases", "right", "in a set", "wrong", "withheld", "stated", "covered")
    return Table(head, rows, title=f"{len(result.cases)} cases of another simulator")

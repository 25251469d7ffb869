"""One case of the second simulator, from its files through the command to its score."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tombo_benchmarks.diagnosis.evaluation import case_row
from tombo_benchmarks.diagnosis.foreign_cases import ForeignCase, draw_case, write_flights
from tombo_benchmarks.diagnosis.runner import BenchmarkResult, Row, run_benchmark
from tombo_benchmarks.diagnosis.score import score, score_of_flights
from tombo_benchmarks.diagnosis.second_simulator.flight import LostError
from tombo_benchmarks.diagnosis.second_simulator.hidden import known, typical
from tombo_benchmarks.diagnosis.second_simulator.vehicles import VEHICLES
from tombo_dynamics.errors import InputError

Ask = Callable[[Sequence[str]], str]
"""Arguments of `tombo diagnose` to what it prints; InputError where it refuses."""
_NAMING = ("named", "set")


def examine(ask: Ask, seed: int, number: int) -> Row:
    """Fly, write, diagnose and score one case."""
    return examine_case(ask, draw_case(seed, number))


def examine_case(ask: Ask, case: ForeignCase) -> Row:
    """Return the score of a case as plain values."""
    row = case_row(case) | {
        "vehicle": case.vehicle.name, "known": case.known, "chain": case.chain,
        "log_format": case.log_format, "present": sorted(case.present),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        try:
            files = write_flights(case, Path(folder))
        except LostError as error:
            return row | {"verdict": "not flown", "why": str(error)}
        try:
            said = json.loads(ask([*files.arguments, "--json"]))
        except InputError as error:
            return row | _counted(case, "refused", [], [], 0.0) | {"why": str(error)}
    return row | answer_row(case, said)


def answer_row(case: ForeignCase, said: Mapping[str, Any]) -> Row:
    """Return what was answered, and what of it counts."""
    causes = [cause["effect"] for cause in said["causes"]]
    row = _counted(case, said["verdict"], causes, said["set"], said["confidence"])
    row["said"] = {
        "verdict": said["verdict"], "set": said["set"], "summary": said["summary"],
        "causes": {
            c["effect"]: {n: t["value"] for n, t in c["theta"].items()} for c in said["causes"]
        },
        "prechecks": [
            f"{p['flight']}: {p['check']}: {p['message']}"
            for p in said["prechecks"] if p["severity"] != "info"
        ],
        "candidates": [
            (c["effect"], c["evidence"], c["gain"]) for c in said["candidates"][:4]
        ],
    }  # fmt: skip
    row["seconds"] = said["seconds"]
    if row["verdict"] == "named" and set(row["causes"]) == set(case.hidden):
        row["parameters"] = {
            c["effect"]: _compared(case, c) for c in said["causes"] if c["effect"] in case.hidden
        }
    return row


def _counted(
    case: ForeignCase, verdict: str, causes: Sequence[str], members: Sequence[str], stated: float
) -> Row:
    """Return an answer without the effects that are there besides: naming them is right."""
    kept = [c for c in causes if c not in case.present]
    others = [m for m in members if m not in case.present]
    if verdict in _NAMING and not kept and not others:
        verdict = "none"
    return {"verdict": verdict, "causes": kept, "set": others, "confidence": stated}


def _compared(case: ForeignCase, cause: Mapping[str, Any]) -> dict[str, Any]:
    """Return the relative error of a cause's change, and which intervals cover the truth."""
    name = cause["effect"]
    off = size = 0.0
    covered = []
    for p, fit in cause["theta"].items():
        label = f"{name}.{p}"
        if label not in case.truth.values:
            continue
        true = known(label, case.vehicle) + case.truth[label]
        unit = typical(name, p, case.vehicle)
        off += ((fit["value"] - true) / unit) ** 2
        size += ((true - fit["nominal"]) / unit) ** 2
        if label in case.shift:
            covered.append(bool(fit["low"] <= true <= fit["high"]))
    return {"error": math.sqrt(off / size) if size else None, "covered": covered}


def aggregate(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of the flights with an IMU, of those without, and of each vehicle."""
    flown = [r for r in rows if r["verdict"] != "not flown"]
    own = {name: score([r for r in flown if r["vehicle"] == name]) for name in VEHICLES}
    return score_of_flights(rows) | {"nominal": "command", "all": score(flown)} | own


def benchmark(ask: Ask, *options: Any) -> BenchmarkResult:
    """Run many cases of the second simulator through a command; options of `run_benchmark`."""
    return run_benchmark(partial(examine, ask), aggregate, *options)

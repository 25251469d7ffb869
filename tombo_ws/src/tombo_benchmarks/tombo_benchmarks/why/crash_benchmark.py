"""Simulated crashes, each from its files through `why` to its score."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from tombo_benchmarks.diagnosis.runner import BenchmarkResult, Row, run_benchmark
from tombo_benchmarks.diagnosis.second_simulator.vehicles import VEHICLES
from tombo_benchmarks.why.crash_flight import fly_crash
from tombo_benchmarks.why.crash_log import write_crash
from tombo_benchmarks.why.mishap import KINDS, Array, Mishap, began
from tombo_diagnosis.crash.reason import why
from tombo_logs.readers.csv_mapping import load_mapping
from tombo_logs.readers.log_reader import read_log

_PACKAGE: Final = Path(__file__).parents[2]
_PEER: Final = _PACKAGE / "other_environments" / "rotorpy_crashes.py"
_OUR_ORDER, _PEER_ORDER = (1, 2, 3, 0), (1, 3, 0, 2)
"""Columns of the rotors in the order of ROTOR_NAMES."""
_CLOSE_S: Final = 0.1
_ABSTAINED: Final = ("set", "unknown", "none")


def examine(rotorpy: str, seed: int, number: int) -> Row:
    """Fly, write and ask; odd numbers fly with rotorpy, if its Python is given."""
    kind = list(KINDS)[number // 2 % len(KINDS)]
    peer = bool(rotorpy) and number % 2 == 1
    rng = np.random.default_rng([seed, number])
    mishap = Mishap.draw(kind, rng)
    with tempfile.TemporaryDirectory() as folder:
        if peer:
            rows, start = _fly_peer(rotorpy, Path(folder), [seed, number], kind)
        else:
            quad = VEHICLES[sorted(VEHICLES)[number // 20 % len(VEHICLES)]]
            rows, start = fly_crash(quad, mishap, rng)
        true = began(mishap, rows[:, 0], rows[:, 8:11], rows[:, 18:22], start)
        order = _PEER_ORDER if peer else _OUR_ORDER
        noise = np.random.default_rng([seed, number, 5])
        log, mapping = write_crash(Path(folder), rows, mishap, order, noise)
        found = why(read_log(log, "crash", load_mapping(mapping)))
    return {
        "case": number, "kind": kind, "simulator": "rotorpy" if peer else "second",
        "cause": KINDS[kind], "time_s": true, "said": found.cause, "said_s": found.time_s,
        "confidence": found.confidence, "channels": sorted(found.flight.series),
    }  # fmt: skip


def _fly_peer(python: str, folder: Path, seed: list[int], kind: str) -> tuple[Array, float]:
    orders = folder / "orders.json"
    path = folder / "rows.npz"
    orders.write_text(json.dumps([{"path": str(path), "seed": seed, "kind": kind}]))
    env = {**os.environ, "PYTHONPATH": str(_PACKAGE), "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([python, _PEER, orders], check=True, env=env)
    with np.load(path) as flown:
        return flown["rows"], float(flown["began"])


def aggregate(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of all cases, and of each kind."""
    return _score(rows) | {
        "kinds": {k: _score([r for r in rows if r["kind"] == k]) for k in KINDS}
    }


def _score(rows: Sequence[Row]) -> dict[str, Any]:
    if not rows:
        return {"cases": 0}
    late = [abs(r["said_s"] - r["time_s"]) for r in rows if r["said_s"] is not None]
    right = [r["said"] == r["cause"] for r in rows]
    return {
        "cases": len(rows),
        "right": float(np.mean(right)),
        "in_time": float(np.sum(np.array(late) <= _CLOSE_S) / len(rows)),
        "wrong": sum(r["said"] not in (r["cause"], *_ABSTAINED) for r in rows),
        "abstained": sum(r["said"] in _ABSTAINED for r in rows),
        "stated": float(np.mean([r["confidence"] for r in rows])),
    }


def benchmark(rotorpy: str, *options: Any) -> BenchmarkResult:
    """Ask about many crashes.

    `rotorpy`: a Python that has it, or empty; `options`: of `run_benchmark`.
    """
    return run_benchmark(partial(examine, rotorpy), aggregate, *options)

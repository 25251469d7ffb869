"""Simulated crashes, each from its files through `why` to its score."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from tombo_benchmarks.diagnosis.runner import Row
from tombo_benchmarks.why.crash_log import write_crash
from tombo_benchmarks.why.mishap import KINDS, Array, Mishap, began
from tombo_diagnosis.crash.reason import why
from tombo_logs.readers.csv_mapping import load_mapping
from tombo_logs.readers.log_reader import read_log

_ROTOR_COLUMNS: Final = (1, 3, 0, 2)
"""Columns of the Hummingbird's rotors in the order of ROTOR_NAMES."""
_PACKAGE: Final = Path(__file__).parents[2]
_SCRIPT: Final = _PACKAGE / "other_environments" / "rotorpy_crashes.py"
_CLOSE_S: Final = 0.1
_ABSTAINED: Final = ("set", "unknown", "none")


def examine(rotorpy: str, seed: int, number: int) -> Row:
    """Fly with the Python that has rotorpy, write and ask."""
    kind = list(KINDS)[number % len(KINDS)]
    with tempfile.TemporaryDirectory() as folder:
        orders, path = Path(folder) / "orders.json", Path(folder) / "crash.npz"
        order = {"path": str(path), "seed": [seed, number], "kind": kind}
        orders.write_text(json.dumps([order]), encoding="utf-8")
        env = {**os.environ, "PYTHONPATH": str(_PACKAGE), "OPENBLAS_NUM_THREADS": "1"}
        subprocess.run([rotorpy, _SCRIPT, orders], check=True, env=env)
        return examine_crash(kind, (seed, number), *read_crash(path))


def read_crash(path: Path) -> tuple[Array, float]:
    """Return the rows of a recorded crash, as `write_crash` takes them, and when it began [s]."""
    with np.load(path) as flown:
        return flown["rows"].astype(np.float64), float(flown["began"])


def examine_crash(kind: str, seed: tuple[int, int], rows: Array, start: float) -> Row:
    """Write a crash and ask what it was."""
    mishap = Mishap.draw(kind, np.random.default_rng(seed))
    true = began(mishap, rows[:, 0], rows[:, 8:11], rows[:, 18:22], start)
    noise = np.random.default_rng([*seed, 5])
    with tempfile.TemporaryDirectory() as folder:
        log, mapping = write_crash(Path(folder), rows, mishap, _ROTOR_COLUMNS, noise)
        said = why(read_log(log, "crash", load_mapping(mapping)))
    return {
        "case": seed[1], "kind": kind, "cause": KINDS[kind], "time_s": true, "said": said.cause,
        "said_s": said.time_s, "confidence": said.confidence,
        "channels": sorted(said.flight.series),
    }  # fmt: skip


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

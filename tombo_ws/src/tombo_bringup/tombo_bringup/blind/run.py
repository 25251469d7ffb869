"""Many blind cases on several processes."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

from tombo_bringup.blind.examine import examine
from tombo_bringup.blind.score import aggregate

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class BenchmarkResult:
    """What the benchmark came to."""

    cases: list[dict[str, Any]]
    aggregate: dict[str, Any]


def benchmark(cases: int, seed: int, workers: int, progress: Progress) -> BenchmarkResult:
    """Hide, diagnose and score.

    Args:
        cases: how many.
        seed: of all chance.
        workers: processes.
        progress: called with a stage and the share done.
    """
    rows: list[dict[str, Any]] = []
    # One thread of linear algebra a process: more get into each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, cases), mp_context=context)
    try:
        for row in pool.map(examine, [seed] * cases, range(cases)):
            rows.append(row)
            progress(f"case {len(rows)} of {cases}", len(rows) / cases)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return BenchmarkResult(rows, aggregate(rows))

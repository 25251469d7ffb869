"""Many synthetic cases on several processes, scored: of flights or of stands."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from tombo_flight.process.process_pool import run_in_processes
from tombo_flight.progress import ProgressCallback

Row = dict[str, Any]


@dataclass(frozen=True)
class BenchmarkResult:
    """Result of a benchmark."""

    cases: list[Row]
    aggregate: dict[str, Any]


def run_benchmark(
    examine: Callable[[int, int], Row],
    aggregate: Callable[[Sequence[Row]], dict[str, Any]],
    cases: int,
    seed: int,
    workers: int,
    progress: ProgressCallback,
    stop: Callable[[], bool] | None = None,
) -> BenchmarkResult:
    """Hide, diagnose and score.

    Args:
        examine: (seed, number) to the score of one case; can be sent to another process.
        aggregate: the score of all.
        cases: how many.
        seed: of all chance.
        workers: processes.
        progress: called with a stage and the share done.
        stop: asked ten times a second; True ends it with the cases up to the first one missing.
    """
    # One thread of linear algebra a process: more get into each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows = run_in_processes(
        partial(examine, seed),
        range(cases),
        min(workers, cases),
        progress=lambda done: progress(f"case {done} of {cases}", done / cases),
        stop=stop,
    )
    return BenchmarkResult(rows, aggregate(rows))

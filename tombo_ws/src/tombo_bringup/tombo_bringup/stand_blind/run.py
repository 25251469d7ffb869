"""Many blind stand cases on several processes."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

from tombo_bringup.blind.run import BenchmarkResult, Progress
from tombo_bringup.processes import on_processes
from tombo_bringup.stand_blind.examine import examine
from tombo_bringup.stand_blind.score import aggregate


def benchmark_stand(
    cases: int,
    seed: int,
    workers: int,
    progress: Progress,
    stop: Callable[[], bool] | None = None,
) -> BenchmarkResult:
    """Hide, diagnose and score.

    Args:
        cases: how many.
        seed: of all chance.
        workers: processes.
        progress: called with a stage and the share done.
        stop: asked ten times a second; True ends it with the cases up to the first one missing.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows = on_processes(
        partial(examine, seed),
        range(cases),
        min(workers, cases),
        progress=lambda done: progress(f"case {done} of {cases}", done / cases),
        stop=stop,
    )
    return BenchmarkResult(rows, aggregate(rows))

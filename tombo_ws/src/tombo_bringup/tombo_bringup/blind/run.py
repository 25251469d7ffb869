"""Many blind cases on several processes."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from tombo_bringup.blind.examine import examine
from tombo_bringup.blind.score import aggregate
from tombo_bringup.processes import on_processes

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class BenchmarkResult:
    """What the benchmark came to."""

    cases: list[dict[str, Any]]
    aggregate: dict[str, Any]


def benchmark(
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
    # One thread of linear algebra a process: more get into each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows = on_processes(
        partial(examine, seed),
        range(cases),
        min(workers, cases),
        progress=lambda done: progress(f"case {done} of {cases}", done / cases),
        stop=stop,
    )
    return BenchmarkResult(rows, aggregate(rows))

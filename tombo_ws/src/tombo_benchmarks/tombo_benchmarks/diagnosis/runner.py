"""Many synthetic cases on several processes, scored: of flights or of stands."""

from __future__ import annotations

import os
from collections.abc import Callable, MutableMapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from typing import Any

from tombo_flight.process.workers import run_in_processes
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
    kept: MutableMapping[int, Row] | None = None,
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
        kept: number of a case → its score, of an earlier run; gets those of this one.
    """
    # One thread of linear algebra a process: more get into each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows = {} if kept is None else kept
    left = [number for number in range(cases) if number not in rows]
    known = cases - len(left)
    examined = partial(_examined, examine, seed)
    with closing(run_in_processes(examined, left, min(workers, len(left)) or 1, stop=stop)) as new:
        for done, (number, row) in enumerate(new, known + 1):
            rows[number] = row
            progress(f"case {done} of {cases}", done / cases)
    in_order = [rows[number] for number in takewhile(rows.__contains__, range(cases))]
    return BenchmarkResult(in_order, aggregate(in_order))


def _examined(examine: Callable[[int, int], Row], seed: int, number: int) -> tuple[int, Row]:
    return number, examine(seed, number)

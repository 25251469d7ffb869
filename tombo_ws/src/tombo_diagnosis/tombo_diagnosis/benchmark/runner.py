"""Many synthetic cases on several processes, scored: of flights or of stands."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from typing import Any, Protocol

from tombo_flight.process.process_pool import run_in_processes
from tombo_flight.progress import ProgressCallback

Row = dict[str, Any]


class KeptRows(Protocol):
    """Scores that outlast a run."""

    @property
    def rows(self) -> dict[int, Row]:
        """Number of the case → its score."""

    def add(self, number: int, row: Row) -> None:
        """Keep a score."""


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
    kept: KeptRows | None = None,
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
        kept: scores of an earlier run, which are not made again; gets those of this one.
    """
    # One thread of linear algebra a process: more get into each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows = {} if kept is None else {n: row for n, row in kept.rows.items() if n < cases}
    left = [number for number in range(cases) if number not in rows]
    known = len(rows)
    made = run_in_processes(
        partial(examine, seed),
        left,
        max(min(workers, len(left)), 1),
        progress=lambda done: progress(f"case {known + done} of {cases}", (known + done) / cases),
        keep=None if kept is None else kept.add,
        stop=stop,
    )
    rows |= zip(left, made, strict=False)
    in_order = [rows[number] for number in takewhile(rows.__contains__, range(cases))]
    return BenchmarkResult(in_order, aggregate(in_order))

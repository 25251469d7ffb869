"""Many synthetic cases on several processes, scored: of flights or of stands."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, MutableMapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from typing import Any, TypeVar

from tombo_flight.process.workers import run_in_processes
from tombo_flight.progress import ProgressCallback

Row = dict[str, Any]
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


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
    found = each_result(partial(examine, seed), left, min(workers, len(left)) or 1, stop)
    for done, (number, row) in enumerate(found, known + 1):
        rows[number] = row
        progress(f"case {done} of {cases}", done / cases)
    in_order = [rows[number] for number in takewhile(rows.__contains__, range(cases))]
    return BenchmarkResult(in_order, aggregate(in_order))


def each_result(
    work: Callable[[_Item], _Result],
    items: Iterable[_Item],
    workers: int,
    stop: Callable[[], bool] | None,
) -> Iterator[tuple[_Item, _Result]]:
    """Do the work on several processes; yield each item with its result, as they come."""
    with closing(run_in_processes(partial(_with_item, work), items, workers, stop=stop)) as found:
        yield from found


def _with_item(work: Callable[[_Item], _Result], item: _Item) -> tuple[_Item, _Result]:
    return item, work(item)

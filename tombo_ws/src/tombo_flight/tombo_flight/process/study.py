"""Many flights: a study says what is flown at a point, processes or a cluster fly it.

A campaign, a sweep, a question about risk and an arena are studies: points, seeds, and what is
kept of each flight.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

from tombo_dynamics.errors import InputError
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_output import flight_summary
from tombo_flight.process.cluster import run_on_cluster
from tombo_flight.process.process_pool import process_count, run_in_processes
from tombo_flight.scenario import Scenario

Row = dict[str, Any]
"""What is kept of a flight; `error` says why one could not be flown."""
Progress = Callable[[int, float | None], None]
"""Called with the number of flights kept, and the time left [s] where it is known."""
_SCENARIOS = 1024
"""Scenarios that a process keeps: those of an arena are flown in turn, seed by seed."""


class Study(Protocol):
    """What is flown; it can be sent to other processes."""

    def scenario_at(self, point: Any, /) -> Scenario:
        """Return what is flown at a point.

        Raises:
            InputError: it is no scenario.
        """
        ...

    def figures(self, summary: Mapping[str, Any], scenario: Scenario, /) -> Row:
        """Return what is kept of a flight, from its summary."""
        ...


class Task(NamedTuple):
    """One flight of a study."""

    key: Any
    """Number or name of its row."""
    point: Any
    """As `Study.scenario_at` takes it; it can be hashed."""
    seed: int


Flown = tuple[Task, Row]


class _Flyer:
    """Flies tasks of a study; keeps memory and scenarios from flight to flight."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self._workspace = Workspace()
        self._scenario_at = lru_cache(_SCENARIOS)(study.scenario_at)

    def fly(self, task: Task) -> Row:
        try:
            scenario = self._scenario_at(task.point)
            record = fly_scenario(scenario, task.seed, self._workspace)
        except InputError as error:
            return {"error": str(error)}
        return self.study.figures(flight_summary(record), scenario)


_here = threading.local()


def begin_flying(study: Study) -> None:
    """Prepare a process, or a thread: it keeps the study, its memory and its scenarios."""
    _here.flyer = _Flyer(study)


def fly_task(task: Task) -> Flown:
    """Fly a task of the study that this thread is prepared for."""
    return task, _here.flyer.fly(task)


def fly_tasks(
    study: Study,
    tasks: Iterable[Task],
    count: int,
    keep: Callable[[Task, Row], None],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    stop: Callable[[], bool] | None = None,
) -> None:
    """Fly tasks of a study, in any order; each row is kept as soon as its flight is over.

    Args:
        study: what is flown; `flight_output.warm_up_flight` one of its scenarios first.
        tasks: what is flown of it.
        count: number of tasks.
        keep: called with each task and its row.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        stop: asked ten times a second; True ends it.

    Raises:
        InputError: the scheduler can't be reached, or has another version of the suite.
    """
    if not count:
        return
    if scheduler is None:
        found = run_in_processes(
            fly_task,
            tasks,
            min(process_count(workers), count),
            begin=begin_flying,
            given=(study,),
            stop=stop,
            copies=True,
        )
    else:
        found = run_on_cluster(
            scheduler, fly_task, tasks, count, begin=begin_flying, given=(study,), stop=stop
        )
    with closing(found):
        for task, row in found:
            keep(task, row)


def pace(progress: Progress | None, kept: Callable[[], int], of: int) -> Callable[[], None]:
    """Return what tells the progress from now on: the flights kept, and the time left."""
    began, before = time.monotonic(), kept()

    def tell() -> None:
        if progress is not None:
            rate = (kept() - before) / max(time.monotonic() - began, 1e-6)
            progress(kept(), (of - kept()) / rate if rate > 0.0 else None)

    return tell

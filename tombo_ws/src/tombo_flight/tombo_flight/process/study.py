"""Many flights: a study says what is flown at a point, processes or a cluster fly it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, NamedTuple, Protocol

from tombo_bag.flight import Flight
from tombo_dynamics.errors import InputError
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_output import warm_up_flight
from tombo_flight.process.workers import process_count, run_in_processes, run_on_cluster
from tombo_flight.scenario import Scenario

FlightRow = dict[str, Any]
"""Figures of a flight by name; `error` says why one could not be flown."""
_CLUSTER_WORKERS = 64
"""Workers that are assumed of a cluster, whose size may change."""
_BATCHES = 24
"""Least number of batches of a worker, so that all end at about the same time."""
_LARGEST_BATCH = 64


class Task(NamedTuple):
    """One flight of a study."""

    key: Any
    """Number or name of its row."""
    point: Any
    """Argument of `FlownStudy.scenario_at`."""
    seed: int


class FlownStudy(Protocol):
    """A study of many flights; it can be sent to other processes."""

    @property
    def summary_only(self) -> bool:
        """Whether `figures` reads only the summary of a flight; its log is then shorter."""
        ...

    def scenario_at(self, point: Any, /) -> Scenario:
        """Return the flight of a point.

        Raises:
            InputError: it is not a scenario.
        """
        ...

    def figures(self, flight: Flight, /) -> FlightRow:
        """Return the kept data of a flight."""
        ...


FlownTasks = list[tuple[Task, FlightRow]]


class _Flyer:
    """Flies tasks of a study; keeps memory and the latest scenario from flight to flight."""

    def __init__(self, study: FlownStudy) -> None:
        self.study = study
        self._workspace = Workspace(figures_only=study.summary_only)
        self._scenario: tuple[Any, Scenario] | None = None

    def fly(self, task: Task) -> FlightRow:
        try:
            if self._scenario is None or self._scenario[0] != task.point:
                self._scenario = (task.point, self.study.scenario_at(task.point))
            flight = fly_scenario(self._scenario[1], task.seed, self._workspace)
        except InputError as error:
            return {"error": str(error)}
        return self.study.figures(flight)


_here = threading.local()


def begin_flying(study: FlownStudy) -> None:
    """Prepare a process, or a thread: it keeps the study, its memory and its scenario."""
    _here.flyer = _Flyer(study)


def fly_batch(tasks: Sequence[Task]) -> FlownTasks:
    """Fly tasks of the study that this thread is prepared for."""
    return [(task, _here.flyer.fly(task)) for task in tasks]


def fly_tasks(
    study: FlownStudy,
    tasks: Iterable[Task],
    count: int,
    keep: Callable[[FlownTasks], None],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    stop: Callable[[], bool] | None = None,
) -> None:
    """Fly tasks of a study in batches, in any order.

    Args:
        study: makes the scenarios and the rows.
        tasks: its flights; consecutive ones of a point share one scenario.
        count: number of tasks, or more.
        keep: called with the tasks of a batch and their rows, as soon as they are flown.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        stop: called ten times a second; True ends the study.

    Raises:
        InputError: the scheduler can't be reached, or has another version of the suite.
    """
    left = iter(tasks)
    first = next(left, None)
    if first is None:
        return
    processes = _CLUSTER_WORKERS if scheduler else min(process_count(workers), max(count, 1))
    size = min(max(count // (_BATCHES * processes), 1), _LARGEST_BATCH)
    batches = _batches(chain([first], left), size)
    if scheduler is None:
        with suppress(InputError):  # a flight that can't be flown says so in its row
            warm_up_flight(study.scenario_at(first.point))  # once, not in each process
        found = run_in_processes(
            fly_batch,
            batches,
            processes,
            begin=begin_flying,
            given=(study,),
            stop=stop,
            copies=True,
        )
    else:
        found = run_on_cluster(
            scheduler, fly_batch, batches, begin=begin_flying, given=(study,), stop=stop
        )
    with closing(found):
        for flown in found:
            keep(flown)


def _batches(tasks: Iterator[Task], size: int) -> Iterator[list[Task]]:
    while batch := list(islice(tasks, size)):
        yield batch


@dataclass(frozen=True)
class _ManySeeds:
    """The study of one scenario, flown with many seeds."""

    scenario: Scenario
    figures: Callable[[Flight], FlightRow]
    summary_only: bool

    def scenario_at(self, point: None) -> Scenario:
        return self.scenario


def fly_seeds(
    scenario: Scenario,
    seeds: Sequence[int],
    figures: Callable[[Flight], FlightRow],
    *,
    summary_only: bool = False,
    progress: Callable[[int], None] | None = None,
) -> dict[int, FlightRow]:
    """Fly one scenario with many seeds; return the rows by seed, in the order of the seeds.

    Args:
        scenario: flown with each seed.
        seeds: of the flights.
        figures: returns the row of a flight; a function of a module.
        summary_only: `figures` reads only the summary of a flight.
        progress: called with the number of flights done.
    """
    rows: dict[int, FlightRow] = {}

    def keep(flown: FlownTasks) -> None:
        rows.update({task.seed: row for task, row in flown})
        if progress is not None:
            progress(len(rows))

    tasks = [Task(seed, None, seed) for seed in seeds]
    study = _ManySeeds(scenario, figures, summary_only)
    fly_tasks(study, tasks, len(tasks), keep)
    return {seed: rows[seed] for seed in seeds}

"""Many flights: a study says what is flown at a point, processes or a cluster fly it.

A campaign, a sweep, a question about risk and an arena are studies: points, seeds, and what is
kept of each flight.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from itertools import takewhile
from typing import Any, NamedTuple, Protocol

from tombo_bag.flight import Flight
from tombo_collision.own_reactions import imported_files
from tombo_dynamics.errors import InputError
from tombo_flight.command_line import fly_command
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.json_text import plain
from tombo_flight.process.workers import process_count, run_in_processes, run_on_cluster
from tombo_flight.scenario import Scenario, scenario_values, with_settings
from tombo_flight.version import tombo_version

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

    def figures(self, flight: Flight, scenario: Scenario, /) -> Row:
        """Return what is kept of a flight."""
        ...


class Task(NamedTuple):
    """One flight of a study."""

    key: Any
    """Number or name of its row."""
    point: Any
    """As `Study.scenario_at` takes it; it can be hashed."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class StudiedScenario:
    """A scenario with what is the same in all flights of a study.

    Its values are complete: nothing is read again when the study goes on.
    """

    scenario: str
    """Name or file, as given."""
    settings: tuple[str, ...]
    """Texts of --set."""
    label: str
    """Name of the scenario."""
    values: Mapping[str, Any]
    """Of the scenario, in the types of JSON."""
    tombo_version: str
    model: str
    vehicle: str
    imports: tuple[tuple[str, str], ...]
    """Files with the user's reactions, as of `imported_files`."""

    def scenario_with(self, more: Iterable[str]) -> Scenario:
        """Return what is flown with further settings.

        Raises:
            InputError: it is no scenario.
        """
        return with_settings(dict(self.values), [*self.settings, *more], self.label)

    def command_with(self, more: Iterable[str], seed: int) -> str:
        """Return the command line that flies a flight with further settings again."""
        return fly_command(
            self.scenario,
            seed,
            settings=[*self.settings, *more],
            model=self.model,
            vehicle=self.vehicle,
            imports=self.imports,
        )


def read_scenario(
    scenario: str, settings: Iterable[str], model: str | None, vehicle: str | None
) -> dict[str, Any]:
    """Return the fields of a `StudiedScenario`; arguments and errors as of `load_scenario`."""
    values, label = scenario_values(scenario, model, vehicle)
    return {
        "scenario": scenario,
        "settings": tuple(settings),
        "label": label,
        "values": plain(values),
        "tombo_version": tombo_version(),
        "model": model or "",
        "vehicle": vehicle or "",
        "imports": imported_files(),
    }


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
            flight = fly_scenario(scenario, task.seed, self._workspace)
        except InputError as error:
            return {"error": str(error)}
        return self.study.figures(flight, scenario)


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


@dataclass(frozen=True)
class _OneScenario:
    """The study of one scenario, flown with many seeds."""

    scenario: Scenario
    kept: Callable[[Flight], Row]

    def scenario_at(self, point: None) -> Scenario:
        return self.scenario

    def figures(self, flight: Flight, scenario: Scenario) -> Row:
        return self.kept(flight)


def fly_seeds(
    scenario: Scenario,
    seeds: Sequence[int],
    figures: Callable[[Flight], Row],
    *,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[int, Row]:
    """Fly one scenario with many seeds; return the rows by seed, up to the first one missing.

    Args:
        scenario: what to fly; `flight_output.warm_up_flight` it first.
        seeds: of the flights.
        figures: what is kept of a flight; a function of a module.
        workers: number of processes; the cores that this process may use if None.
        progress: called with the number of flights done.
        stop: asked ten times a second; True ends all processes.
    """
    rows: dict[int, Row] = {}

    def keep(task: Task, row: Row) -> None:
        rows[task.seed] = row
        if progress is not None:
            progress(len(rows))

    tasks = [Task(seed, None, seed) for seed in seeds]
    study = _OneScenario(scenario, figures)
    fly_tasks(study, tasks, len(tasks), keep, workers=workers, stop=stop)
    return {seed: rows[seed] for seed in takewhile(rows.__contains__, seeds)}


def pace(progress: Progress | None, kept: Callable[[], int], of: int) -> Callable[[], None]:
    """Return what tells the progress from now on: the flights kept, and the time left."""
    began, before = time.monotonic(), kept()

    def tell() -> None:
        if progress is not None:
            rate = (kept() - before) / max(time.monotonic() - began, 1e-6)
            progress(kept(), (of - kept()) / rate if rate > 0.0 else None)

    return tell

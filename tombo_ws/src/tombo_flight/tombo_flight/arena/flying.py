"""Fly every reaction in every case; keep a few figures of each flight."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from tombo_bag.flight import Flight
from tombo_collision.own_reactions import imported_files, is_own
from tombo_dynamics.errors import InputError
from tombo_flight.arena.cases import Case, Match
from tombo_flight.campaign.statistics import SPREAD_METRICS
from tombo_flight.flight_output import flight_summary, warm_up_flight
from tombo_flight.process.study import Task, fly_tasks
from tombo_flight.scenario import Scenario

ROW_KEYS: Final = (
    *("seed", "collided", "detected", "crashed", "landed", "false_alarms"),
    *("contact_rotor", "struck_rotor", *SPREAD_METRICS),
)
"""What is kept of a flight's summary."""
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Plan:
    """What an arena flies: the study whose points are matches."""

    matches: tuple[Match, ...]
    tasks: tuple[Task, ...]
    """Keyed by reaction, case, seed and a hash of the scenario. Seed by seed, ascending, so that
    what is stopped has as many flights of each match."""
    refused: Mapping[str, str]
    """Cases that can't be flown → the reason."""

    def scenario_at(self, match: Match) -> Scenario:
        """Return what is flown in a match."""
        return match.scenario()

    def figures(self, flight: Flight, scenario: Scenario) -> dict[str, Any]:
        """Return what is kept of a flight."""
        summary = flight_summary(flight)
        return {key: summary[key] for key in ROW_KEYS}

    def rows(self, kept: Mapping[str, Row]) -> dict[Match, list[Row]]:
        """Return what is kept of the flights of each match, in the order of the seeds.

        Flights that could not be flown are left out; see `not_flown`.
        """
        found: dict[Match, list[Row]] = {match: [] for match in self.matches}
        for task in self.tasks:
            if "error" not in kept[task.key]:
                found[task.point].append(kept[task.key])
        return found

    def not_flown(self, kept: Mapping[str, Row]) -> dict[str, str]:
        """Return what could not be flown, besides `refused` → the reason of the first flight."""
        errors: dict[Match, list[str]] = {}
        for task in self.tasks:
            if "error" in kept[task.key]:
                why = f"seed {task.seed}: {kept[task.key]['error']}"
                errors.setdefault(task.point, []).append(why)
        return {
            f"{match.case.name} with {match.reaction} ({len(of)} flights)": of[0]
            for match, of in errors.items()
        }


def new_plan(
    reactions: Sequence[str], cases: Iterable[Case], seeds: range, *, disturbed: bool
) -> Plan:
    """Return the flights of an arena; a case whose vehicle can't lift off is left out."""
    flown, refused = [], {}
    for case in cases:
        try:
            warm_up_flight(Match(reactions[0], case, disturbed).scenario())
        except InputError as error:
            refused[case.name] = str(error)
        else:
            flown.append(case)
    matches = tuple(Match(name, case, disturbed) for case in flown for name in reactions)
    hashes = {match: _hash(match.scenario()) for match in matches}
    tasks = tuple(
        Task(f"{m.reaction}/{m.case.name}/{seed}/{hashes[m]}", m, seed)
        for seed in seeds
        for m in matches
        if seed in m.case.seeds(seeds)
    )
    return Plan(matches, tasks, refused)


def fly_plan(
    plan: Plan,
    kept: MutableMapping[str, dict[str, Any]],
    *,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> None:
    """Fly what is not kept yet; each row is kept as soon as its flight is over.

    Args:
        plan: what is flown.
        kept: rows by key.
        workers: number of processes; the cores that this process may use if None.
        progress: called with the number of flights done here, and of all that were missing.
        stop: asked ten times a second; True ends all processes.
    """
    left = [task for task in plan.tasks if task.key not in kept]
    done = 0

    def keep(task: Task, row: dict[str, Any]) -> None:
        nonlocal done
        kept[task.key] = row if "error" not in row else {"seed": task.seed, **row}
        done += 1
        if progress is not None:
            progress(done, len(left))

    fly_tasks(replace(plan, tasks=()), left, len(left), keep, workers=workers, stop=stop)


def _hash(scenario: Scenario) -> str:
    """Return what tells rows apart: other parameters, figures kept, or code of the user."""
    told = repr((ROW_KEYS, scenario))
    if is_own(scenario.reaction.name):
        told += repr(imported_files())
    return hashlib.sha256(told.encode()).hexdigest()[:8]

"""Fly every reaction in every case; keep a few figures of each flight."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from tombo_collision.own_reactions import imported_files, is_own
from tombo_dynamics.errors import InputError
from tombo_flight.arena.cases import Case, Match
from tombo_flight.campaign.statistics import SPREAD_METRICS
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_output import flight_summary, warm_up_flight
from tombo_flight.process.process_pool import process_count, run_in_processes
from tombo_flight.scenario import Scenario

ROW_KEYS: Final = (
    *("seed", "collided", "detected", "crashed", "landed", "false_alarms"),
    *("contact_rotor", "struck_rotor", *SPREAD_METRICS),
)
"""What is kept of a flight's summary."""
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Job:
    """One flight."""

    match: Match
    seed: int
    key: str
    """Of its row: reaction, case, seed, and a hash of the scenario."""


@dataclass(frozen=True)
class Plan:
    """What an arena flies."""

    matches: tuple[Match, ...]
    jobs: tuple[Job, ...]
    """Seed by seed, ascending, so that what is stopped has as many flights of each match."""
    refused: Mapping[str, str]
    """Cases that can't be flown → the reason."""

    def rows(self, kept: Mapping[str, Row]) -> dict[Match, list[Row]]:
        """Return what is kept of the flights of each match, in the order of the seeds.

        Flights that could not be flown are left out; see `not_flown`.
        """
        found: dict[Match, list[Row]] = {match: [] for match in self.matches}
        for job in self.jobs:
            if "error" not in kept[job.key]:
                found[job.match].append(kept[job.key])
        return found

    def not_flown(self, kept: Mapping[str, Row]) -> dict[str, str]:
        """Return what could not be flown, besides `refused` → the reason of the first flight."""
        errors: dict[Match, list[str]] = {}
        for job in self.jobs:
            if "error" in kept[job.key]:
                why = f"seed {job.seed}: {kept[job.key]['error']}"
                errors.setdefault(job.match, []).append(why)
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
    jobs = tuple(
        Job(m, seed, f"{m.reaction}/{m.case.name}/{seed}/{hashes[m]}")
        for seed in seeds
        for m in matches
        if seed in m.case.seeds(seeds)
    )
    return Plan(matches, jobs, refused)


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
    left = [job for job in plan.jobs if job.key not in kept]
    count = min(process_count(workers), len(left))
    if not left:
        return
    run_in_processes(
        _fly,
        left,
        count,
        begin=_begin,
        keep=lambda job, row: kept.__setitem__(job.key, row),
        progress=None if progress is None else lambda done: progress(done, len(left)),
        stop=stop,
        copies=True,
    )


_workspace: Workspace


def _begin() -> None:
    """Prepare a process: it keeps its memory."""
    global _workspace
    _workspace = Workspace()


@cache
def _scenario(match: Match) -> Scenario:
    return match.scenario()


def _fly(job: Job) -> dict[str, Any]:
    try:
        summary = flight_summary(fly_scenario(_scenario(job.match), job.seed, _workspace))
    except InputError as error:
        return {"seed": job.seed, "error": str(error)}
    return {key: summary[key] for key in ROW_KEYS}


def _hash(scenario: Scenario) -> str:
    """Return what tells rows apart: other parameters, figures kept, or code of the user."""
    told = repr((ROW_KEYS, scenario))
    if is_own(scenario.reaction.name):
        told += repr(imported_files())
    return hashlib.sha256(told.encode()).hexdigest()[:8]

"""`tombo benchmark faults`: the model checker on many cases, and the touchdown test in flight."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from tombo_benchmarks.diagnosis.runner import each_result
from tombo_benchmarks.faults.fault_cases import (
    Case,
    fly_case,
    pair_cases,
    random_case,
    single_cases,
    violations,
)
from tombo_control.controller_core import ControllerCore
from tombo_control.safety.state_machine import TABLE
from tombo_dynamics.core import Core
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.scenario import Scenario, load_scenario
from tombo_flight.scenario_catalogue import builtin_scenarios

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_CHUNK = 100
"""Cases that a process takes at a time."""
_HARD_STRIKE = "effects.blade_strike.peak_force=400"
HARD = ("hard_strikes", "gusts")
"""What is flown besides the built-in scenarios."""


@dataclass(frozen=True)
class FaultBenchmark:
    """What was found.

    Attributes:
        cases: those in which something happened that must not: kind, faults, violations.
        aggregate: counts.
    """

    cases: list[dict[str, Any]]
    aggregate: dict[str, Any]


@dataclass
class _Tally:
    cases: int = 0
    rows: int = 0
    visited: int = 0
    longest_ground_s: float = 0.0
    found: list[dict[str, Any]] = field(default_factory=list)


def enumerated() -> list[Case]:
    """Return every single fault, and every pair, in every phase."""
    return [*single_cases(), *pair_cases()]


def check_cases(cases: Sequence[Case]) -> _Tally:
    """Fly cases; return what was found."""
    tally = _Tally()
    for case in cases:
        verdict = fly_case(case)
        tally.cases += 1
        tally.rows |= int(verdict.rows)
        tally.visited |= int(verdict.visited)
        tally.longest_ground_s = max(tally.longest_ground_s, int(verdict.longest_ground) * 5e-3)
        if bad := violations(case, verdict):
            words = [one.text() for one in case]
            tally.found.append({"faults": words, "violations": bad})
    return tally


def _chunk(work: tuple[int, int, int]) -> _Tally:
    seed, begin, end = work
    if seed < 0:
        return check_cases(enumerated()[begin:end])
    return check_cases([random_case(seed, i) for i in range(begin, end)])


def _results(
    work: Callable[[_Item], _Result],
    items: Sequence[_Item],
    workers: int,
    stage: str,
    progress: Callable[..., Any],
    stop: Callable[[], bool],
) -> list[_Result]:
    """Do the work on several processes; return the results, in the order of the items."""
    found: dict[_Item, _Result] = {}
    for item, result in each_result(work, items, workers, stop):
        found[item] = result
        progress(stage, len(found) / len(items))
    return [found[item] for item in items if item in found]


def check_faults(
    cases: int, seed: int, workers: int, progress: Callable[..., Any], stop: Callable[[], bool]
) -> FaultBenchmark:
    """Check every single fault and pair in every phase, and `cases` random sequences.

    Args:
        cases: random sequences of one to five faults.
        seed: of those.
        workers: processes.
        progress: called with a text and the share that is done.
        stop: asked now and then; True ends it.
    """
    fixed = len(enumerated())
    work = [(-1, i, min(i + _CHUNK, fixed)) for i in range(0, fixed, _CHUNK)]
    work += [(seed, i, min(i + _CHUNK, cases)) for i in range(0, cases, _CHUNK)]
    tallies = _results(_chunk, work, workers, "fault sequences", progress, stop)
    found = [one for tally in tallies for one in tally.found]
    rows = visited = 0
    for tally in tallies:
        rows |= tally.rows
        visited |= tally.visited
    kinds = Counter(name for one in found for name in one["violations"])
    unused = [
        f"{row.state.name.lower()}: {row.condition.name.lower()}"
        for i, row in enumerate(TABLE)
        if not rows >> i & 1
    ]
    aggregate = {
        "enumerated": fixed,
        "random": sum(tally.cases for tally in tallies) - fixed,
        "violations": len(found),
        "by_kind": dict(kinds),
        "longest_ground_s": max(tally.longest_ground_s for tally in tallies),
        "rows_used": len(TABLE) - len(unused),
        "rows_unused": unused,
    }
    return FaultBenchmark(found, aggregate)


def scenario_of(name: str) -> Scenario:
    """Return a built-in scenario, or one of `HARD`."""
    if name == "hard_strikes":
        return load_scenario("paper_collision", ["mission.approach_speed=2.0", _HARD_STRIKE])
    if name == "gusts":
        settings = ["effects.gusts.deviation=2.0", "effects.gusts.time=0.5"]
        return load_scenario("aggressive", settings)
    return load_scenario(name)


def contact_aloft(scenario: Scenario, seed: int, workspace: Workspace | None = None) -> float:
    """Fly; return the longest time for which the touchdown test saw ground in the air [s]."""
    found = []

    def look(cores: Sequence[Core]) -> None:
        controller = next(one for one in cores if isinstance(one, ControllerCore))
        found.append(int(controller.memory.watch.touchdown.longest_aloft) * 1e-3)

    fly_scenario(scenario, seed, workspace, finish=look)
    return found[0]


_workspace = Workspace()


def _fly(work: tuple[str, int]) -> tuple[str, float, float]:
    name, seed = work
    scenario = scenario_of(name)
    return name, contact_aloft(scenario, seed, _workspace), scenario.duration


def touchdown_in_flight(
    flights: int, workers: int, progress: Callable[..., Any], stop: Callable[[], bool]
) -> dict[str, dict[str, float]]:
    """Fly every scenario `flights` times; return by name how near the test came to firing."""
    work = [(name, seed) for seed in range(flights) for name in (*builtin_scenarios(), *HARD)]
    done = _results(_fly, work, workers, "flights", progress, stop)
    found: dict[str, dict[str, float]] = {}
    for name, longest_s, _ in done:
        one = found.setdefault(name, {"flights": 0, "fired": 0, "longest_contact_s": 0.0})
        limit_s = scenario_of(name).safety.touchdown_time
        one["flights"] += 1
        one["fired"] += int(longest_s >= limit_s)
        one["longest_contact_s"] = max(one["longest_contact_s"], longest_s)
    return found

"""Flies the course with all simulators in turn, round by round, and counts steps."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tombo_benchmarks.peers.course import CORNERS, course_scenario, order, starts
from tombo_benchmarks.peers.our_flights import (
    OurFlight,
    OurVehicles,
    OurWholeFlights,
    Reading,
    flown_course,
)
from tombo_benchmarks.peers.peer_process import PEERS, PeerProcess, make_environment
from tombo_dynamics.errors import InputError

OURS: Final = "tombo"
REPLAYED_TICKS: Final = 2000
"""Of the rotor commands that all fly without a controller."""
ProgressText = Callable[[str], None]


@dataclass(frozen=True)
class Case:
    """What one simulator flies in each round."""

    group: str
    """Cases of a group are compared."""
    simulator: str
    action: str
    """fly: physics and controller; fly_whole: with sensors."""
    count: int
    ticks: int


CASES: Final = (
    Case("one vehicle", OURS, "fly", 1, 12000),
    Case("one vehicle", "rotorpy", "fly", 1, 500),
    Case("one vehicle", "crazyflow", "fly", 1, 12000),
    Case("64 vehicles", OURS, "fly", 64, 6000),
    Case("64 vehicles", "crazyflow", "fly", 64, 6000),
    Case("4096 vehicles", OURS, "fly", 4096, 1000),
    Case("4096 vehicles", "crazyflow", "fly", 4096, 1000),
    Case("whole flight", OURS, "fly_whole", 1, 12000),
    Case("whole flight", "rotorpy", "fly_whole", 1, 400),
    Case("64 whole flights", OURS, "fly_whole", 64, 3500),
    Case("4096 whole flights", OURS, "fly_whole", 4096, 3500),
)


@dataclass
class Result:
    """What was measured."""

    readings: dict[Case, list[Reading]]
    before: dict[str, dict[str, float]]
    """Name of what is made before the first flight → times [s]."""
    ends: dict[str, list[float]]
    """Simulator → where one vehicle is at the end of the course, map [m]."""
    replayed: dict[str, float]
    """Peer → distance from our vehicle after the same rotor commands [m]."""
    versions: dict[str, dict[str, str]]
    absent: dict[str, str]
    """Peer → why it is not measured."""
    machine: dict[str, Any]


def measure(folder: Path, rounds: int, progress: ProgressText = lambda text: None) -> Result:
    """Fly all cases `rounds` times in turn; the environments of peers are made in a folder."""
    result = Result({}, {}, {}, {}, {}, {}, _machine())
    with ExitStack() as stack:
        peers: dict[str, PeerProcess] = {}
        sent = order(course_scenario())
        for name in PEERS:
            try:
                python = make_environment(folder, name, progress)
                peers[name] = stack.enter_context(PeerProcess(name, python, sent))
            except InputError as error:
                result.absent[name] = str(error)
                progress(f"without {name}: {error}")
        result.versions = {name: peer.versions for name, peer in peers.items()}
        progress("the same course")
        compare_courses(peers, result)
        flown = {case: _prepared(case, peers, result, progress) for case in CASES}
        ready = {case: fly for case, fly in flown.items() if fly is not None}
        result.readings = {case: [] for case in ready}
        for number in range(rounds):
            for case, fly in ready.items():
                progress(f"round {number + 1} of {rounds}: {case.group}, {case.simulator}")
                result.readings[case].append(fly())
    result.machine["load_after"] = os.getloadavg()[0]
    return result


def compare_courses(peers: Mapping[str, PeerProcess], result: Result) -> None:
    """Fly one vehicle over the whole course with each, and our rotor commands with the peers."""
    commands, positions = flown_course()
    result.ends[OURS] = positions[-1].tolist()
    for name, peer in peers.items():
        if name == "crazyflow":
            peer.ask("prepare", count=1, ticks=len(positions), starts=starts(1).tolist())
        result.ends[name] = peer.ask("fly", count=1, ticks=len(positions))["position"]
        end = peer.ask("replay", commands=commands[:REPLAYED_TICKS].tolist())["position"]
        off = np.array(end) - positions[REPLAYED_TICKS - 1]
        result.replayed[name] = float(np.linalg.norm(off))


def from_goal(result: Result) -> dict[str, float]:
    """Return how far each simulator's vehicle ends from the course's last corner [m]."""
    goal = np.array(CORNERS[-1])
    return {name: float(np.linalg.norm(np.array(end) - goal)) for name, end in result.ends.items()}


def _prepared(
    case: Case, peers: Mapping[str, PeerProcess], result: Result, progress: ProgressText
) -> Callable[[], Reading] | None:
    """Return what flies a case, everything compiled; None: the simulator is absent."""
    name = f"{case.simulator}, {case.group}"
    progress(f"before the first flight: {name}")
    began = time.perf_counter()
    if case.simulator == OURS:
        fly = _ours(case)
    elif case.simulator in peers:
        peer = peers[case.simulator]
        if case.simulator == "crazyflow":
            places = starts(case.count).tolist()
            times = peer.ask("prepare", count=case.count, ticks=case.ticks, starts=places)
            result.before[name] = times

        def fly() -> Reading:
            answer = peer.ask(case.action, count=case.count, ticks=case.ticks)
            return Reading(*(answer[key] for key in ("steps", "wall_s", "processor_s")))
    else:
        return None
    fly()
    result.before.setdefault(name, {"first_flight_s": time.perf_counter() - began})
    return fly


def _ours(case: Case) -> Callable[[], Reading]:
    if case.action == "fly":
        return OurVehicles(case.count, case.ticks).fly
    return OurFlight().fly if case.count == 1 else OurWholeFlights(case.count).fly


def ratios(readings: Mapping[Case, Sequence[Reading]], case: Case) -> list[float]:
    """Return our steps per processor second over a case's, round by round; empty: it is ours."""
    ours = next((c for c in readings if c.group == case.group and c.simulator == OURS), case)
    if case is ours:
        return []
    pairs = zip(readings[ours], readings[case], strict=True)
    return [a.per_processor_s / b.per_processor_s for a, b in pairs]


def _machine() -> dict[str, Any]:
    model = platform.processor()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    cores = len(os.sched_getaffinity(0))
    return {"processor": model, "cores": cores, "load_before": os.getloadavg()[0]}


def as_data(result: Result) -> dict[str, Any]:
    """Return a result as plain values."""
    cases = []
    for case, readings in result.readings.items():
        rows = [asdict(r) | {"steps_per_processor_s": r.per_processor_s} for r in readings]
        cases.append(asdict(case) | {"readings": rows, "ratios": ratios(result.readings, case)})
    return {
        "cases": cases,
        "before_first_flight": result.before,
        "end_from_goal_m": from_goal(result),
        "replay_distance_m": result.replayed,
        "versions": result.versions,
        "absent": result.absent,
        "machine": result.machine,
    }

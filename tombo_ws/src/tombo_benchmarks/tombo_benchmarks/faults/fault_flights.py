"""Kills or stops nodes in a hover of the running suite, and measures the flight after it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from tombo_bag.flight import Flight
from tombo_dynamics.errors import InputError
from tombo_flight.progress import ProgressCallback
from tombo_flight.recorded_flight import read_flight
from tombo_flight.scenario import Scenario, load_scenario
from tombo_flight.suite.node_flight import FlightMonitor
from tombo_flight.suite.nodes import SUITE, free_domain, udp_ports
from tombo_flight.suite.running import RunningSuite, SuiteConfig

KINDS: Final[Mapping[str, float | None]] = {"killed": None, "restarted": 5.0, "stopped": 20.0}
"""What happens to a node; time after which it is there again [s]; None: it is gone for good."""
_HOVER: Final = ("mission.land_time=3500", "mission.hold_time=600", "duration=3600")
"""A mission that never lands by itself."""
_HOVER_S: Final = 5.0
"""So long it has been at its height before the fault."""
_PATIENCE_S: Final = 90.0
_LOOK_S: Final = 0.05
_STANDS_M, _FLIES_M = 0.03, 0.2
"""Above its height on the ground: it stands; it flies again."""
_OFF: Final = 20.0
"""rad/s: a rotor slower than this is off."""


@dataclass(frozen=True)
class NodeFault:
    """A node, and what happens to it: one of `KINDS`."""

    node: str
    kind: str

    def __str__(self) -> str:
        return f"{self.node} {self.kind}"


FAULTS: Final = tuple(
    NodeFault(node, kind)
    for node in ("estimator", "controller", "mission", "reaction", "detector")
    for kind in KINDS
)


def fly_faults(
    behind_s: float,
    seed: int,
    progress: ProgressCallback,
    stop: Callable[[], bool],
    faults: Sequence[NodeFault] = FAULTS,
) -> list[dict[str, Any]]:
    """Fly each fault in real time until a stop; return a row of `after_fault` for each.

    Args:
        behind_s: flight time behind the fault that is looked at [s].
        seed: of the simulator.
        progress: called with the fault and the share done.
        stop: asked now and then.
        faults: which.

    Raises:
        InputError: the vehicle did not come to hover.
    """
    scenario = load_scenario("hover", list(_HOVER))
    ground_m = scenario.vehicle.leg_height
    rows = []
    for i, fault in enumerate(faults):
        progress(str(fault), i / len(faults))
        with TemporaryDirectory(prefix="tombo-") as folder:
            bag = Path(folder) / "flight.mcap"
            at_ns = _fly(fault, scenario, seed, behind_s, Path(folder), bag, stop)
            if stop():
                break
            record = read_flight(bag)
        at_s = (at_ns - record.epoch_ns) * 1e-9
        rows.append({"fault": str(fault), **after_fault(record, ground_m, at_s, behind_s)})
    return rows


def _fly(
    fault: NodeFault,
    scenario: Scenario,
    seed: int,
    behind_s: float,
    folder: Path,
    bag: Path,
    stop: Callable[[], bool],
) -> int:
    """Fly one fault into a recording; return its time, as the simulator's stamp [ns]."""
    config = SuiteConfig(
        scenario=scenario,
        seed=seed,
        folder=folder / "suite",
        recording={"output": str(bag)},
        domain=free_domain(os.getpid(), udp_ports()),
        monitor=("--flight",),
    )
    others = tuple(name for name in SUITE if name != fault.node)
    watch = FlightMonitor(scenario)
    with ExitStack() as stack:
        suite = stack.enter_context(RunningSuite(config))
        at_ns = 0
        high_since = back_s = None
        began_s = time.monotonic()
        while not stop():
            news = suite.poll(_LOOK_S)
            if news.flight is not None:
                watch.see(news.flight)
                high = float(news.flight["height_m"]) > scenario.mission.height - 0.2
                high_since = (high_since or watch.flown_s) if high else None
            if not at_ns:
                if time.monotonic() - began_s > _PATIENCE_S:
                    raise InputError(f"the vehicle did not hover within {_PATIENCE_S:.0f} s")
                if high_since is None or watch.flown_s - high_since < _HOVER_S:
                    continue
                stops = fault.kind == "stopped"
                suite.send_signal(fault.node, signal.SIGSTOP if stops else signal.SIGKILL)
                at_ns = watch.now_ns
                back_s = KINDS[fault.kind]
            behind = (watch.now_ns - at_ns) * 1e-9
            if back_s is not None and behind > back_s:
                back_s = None
                if fault.kind == "stopped":
                    suite.send_signal(fault.node, signal.SIGCONT)
                else:
                    again = replace(config, folder=folder / "again", without=others, monitor=())
                    stack.enter_context(RunningSuite(again))
            if behind > behind_s:
                break
        suite.send_signal(fault.node, signal.SIGCONT)
    return at_ns


def after_fault(record: Flight, ground_m: float, at_s: float, behind_s: float) -> dict[str, Any]:
    """Return figures of the flight after a fault, from the ground truth of a recording.

    Args:
        record: of the flight.
        ground_m: height of a vehicle that stands.
        at_s: flight time of the fault [s].
        behind_s: how long to look.

    Returns:
        `ends`: `hovers`, `rotors off`, `on the ground, rotors on` or `in the air`; `down_s`, from
        fault to touchdown; `rotors_off_s`, from touchdown on; `sink_m_s`, the fastest;
        `drift_m`, across, before touchdown; `slid_m`, behind it; `flew_again`.
    """
    there = (record.t >= at_s) & (record.t <= at_s + behind_s)
    t = record.t[there] - at_s
    place, speed = record.log["position"][there], record.log["rotor_speed"][there].max(axis=1)
    above = place[:, 2] - ground_m
    across = np.linalg.norm(place[:, :2] - place[0, :2], axis=1)
    down = int(np.argmax(above < _STANDS_M)) if (above < _STANDS_M).any() else None
    found: dict[str, Any] = {
        "ends": "hovers" if abs(above[-1] - above[0]) < _FLIES_M else "in the air",
        "down_s": None,
        "rotors_off_s": None,
        "sink_m_s": round(float(-record.log["velocity"][there][:down, 2].min()), 3),
        "drift_m": round(float(across[:down].max()), 3),
        "slid_m": None,
        "flew_again": False,
    }
    if down is None:
        return found
    turning = np.flatnonzero(speed[down:] > _OFF)
    off = down + (int(turning[-1]) + 1 if turning.size else 0)
    found["ends"] = "rotors off" if off < t.size else "on the ground, rotors on"
    found["down_s"] = round(float(t[down]), 2)
    found["rotors_off_s"] = round(float(t[off] - t[down]), 2) if off < t.size else None
    found["slid_m"] = round(
        float(np.linalg.norm(place[down:, :2] - place[down, :2], axis=1).max()), 3
    )
    found["flew_again"] = bool((above[down:] > _FLIES_M).any())
    return found

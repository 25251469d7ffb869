"""State of the suite: a line for people, an object for programs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tombo_dynamics.messages import PHASE_NAMES
from tombo_flight.suite.node_diagnostics import SILENT_S, NodeDiagnostics, NodeStatus
from tombo_flight.suite.supervisor import ProcessExit

_POSE_SILENT_S = 1.0
"""A height that is older says nothing about where the vehicle is."""


@dataclass(frozen=True)
class SuiteState:
    """What there is to know about a running suite.

    Attributes:
        names: of its nodes, in the order in which they are shown.
        pids: of those that run.
        ended: those that have ended.
        node_diagnostics: what the nodes say.
        now_s: on the clock of `node_diagnostics`.
        uptime_s: since the start.
        flight: phase and height_m of the vehicle; empty: not known.
        flight_age_s: age of these.
    """

    names: tuple[str, ...]
    pids: Mapping[str, int]
    ended: Mapping[str, ProcessExit]
    node_diagnostics: NodeDiagnostics
    now_s: float
    uptime_s: float
    flight: Mapping[str, Any] = field(default_factory=dict)
    flight_age_s: float = 0.0

    @property
    def flight_text(self) -> str:
        """Phase and height of the vehicle in words; empty: not known."""
        if not self.flight:
            return ""
        height = f"at {self.flight['height_m']:.2f} m"
        if self.flight_age_s > _POSE_SILENT_S:
            return f"no pose for {self.flight_age_s:.0f} s, last {height}"
        return f"{_phase(self.flight) or 'no phase'} {height}"

    def state(self, name: str) -> str:
        """Return `starting`, `running`, `silent`, or how it ended."""
        if name in self.ended:
            return self.ended[name].exit_text
        status = self.node_diagnostics.nodes.get(name)
        if status is None:
            return "starting"
        return "silent" if self.now_s - status.heard_s > SILENT_S else "running"


def status_line(suite: SuiteState) -> str:
    """Return the suite in one line: how many run, what is wrong."""
    troubles = []
    for name in suite.names:
        state = suite.state(name)
        status = suite.node_diagnostics.nodes.get(name)
        if state != "running":
            troubles.append(f"{name} {state}")
        elif status is not None and status.level:
            troubles.append(f"{name}: {status.message}")
    missed = sum(
        int(loop.number("missed"))
        for name in suite.pids
        for loop in suite.node_diagnostics.nodes.get(name, NodeStatus()).loops
        if not math.isnan(loop.number("missed"))
    )
    running = sum(name in suite.pids for name in suite.names)
    line = f"{suite.uptime_s:.0f} s: {running} of {len(suite.names)} nodes run, {missed} missed"
    age = suite.node_diagnostics.mocap_age_s
    mocap = "no pose of the mocap" if math.isnan(age) else f"mocap {1e3 * age:.0f} ms old"
    return "; ".join([line, *troubles, *([suite.flight_text] if suite.flight else []), mocap])


def status_object(suite: SuiteState) -> dict[str, Any]:
    """Return the suite as plain values."""
    nodes = {}
    for name in suite.names:
        status = suite.node_diagnostics.nodes.get(name, NodeStatus())
        nodes[name] = {
            "pid": suite.pids.get(name),
            "state": suite.state(name),
            "exit_code": suite.ended[name].code if name in suite.ended else None,
            "level": status.level,
            "faults": status.message,
            "values": dict(status.values),
            "loops": {loop.name: dict(loop.metrics) for loop in status.loops},
        }
    return {
        "event": "status",
        "uptime_s": round(suite.uptime_s, 1),
        "phase": _phase(suite.flight) or None,
        "height_m": suite.flight.get("height_m"),
        "height_age_s": round(suite.flight_age_s, 1) if suite.flight else None,
        "nodes": nodes,
    }


def _phase(flight: Mapping[str, Any]) -> str:
    phase = flight.get("phase")
    return "" if phase is None else PHASE_NAMES[phase].replace("_", " ")

"""State of the suite: a table for a terminal, a line for a file, an object for a program."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

from tombo_dynamics.messages import PHASE_NAMES
from tombo_flight.suite.node_diagnostics import (
    SILENT_S,
    NodeDiagnostics,
    NodeStatus,
    figure,
    lateness_text,
)
from tombo_flight.suite.supervisor import ProcessExit

_POSE_SILENT_S = 1.0
"""A height that is older says nothing about where the vehicle is."""
_STYLES = {"running": "green", "starting": "dim", "silent": "bold yellow"}
_FAULT_STYLES = ("", "yellow", "bold red")


@dataclass(frozen=True)
class SuiteState:
    """What there is to know about a running suite.

    Attributes:
        names: of its nodes, in the order in which they are shown.
        pids: of the running nodes.
        ended: the ended nodes.
        node_diagnostics: reports of the nodes.
        now_s: on the clock of `node_diagnostics`.
        uptime_s: since the start.
        flights: vehicle → its phase and height_m, and their age [s]; the name is empty where there
            is only one.
    """

    names: tuple[str, ...]
    pids: Mapping[str, int]
    ended: Mapping[str, ProcessExit]
    node_diagnostics: NodeDiagnostics
    now_s: float
    uptime_s: float
    flights: Mapping[str, tuple[Mapping[str, Any], float]] = field(default_factory=dict)

    @property
    def flight_text(self) -> str:
        """Phase and height of each vehicle in words; empty: not known."""
        return ", ".join(
            f"{name} {_flight_text(*known)}".lstrip()
            for name, known in sorted(self.flights.items())
        )

    def state(self, name: str) -> str:
        """Return `starting`, `running`, `silent`, or how it ended."""
        if name in self.ended:
            return self.ended[name].exit_text
        status = self.node_diagnostics.nodes.get(name)
        if status is None:
            return "starting"
        return "silent" if self.now_s - status.heard_s > SILENT_S else "running"

    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return each node as plain values, by its name."""
        nodes = {}
        for name in self.names:
            status = self.node_diagnostics.nodes.get(name, NodeStatus())
            nodes[name] = {
                "pid": self.pids.get(name),
                "state": self.state(name),
                "exit_code": self.ended[name].code if name in self.ended else None,
                "level": status.level,
                "faults": status.message,
                "values": dict(status.values),
                "loops": {loop: dict(figures) for loop, figures in status.loops.items()},
            }
        return nodes


def _flight_text(flight: Mapping[str, Any], age_s: float) -> str:
    height = f"at {flight['height_m']:.2f} m"
    if age_s > _POSE_SILENT_S:
        return f"no pose for {age_s:.0f} s, last {height}"
    return f"{_phase(flight) or 'no phase'} {height}"


def status_table(suite: SuiteState) -> Group:
    """Return the table, a row a loop; below it what nodes say is wrong, on lines of its own."""
    age = suite.node_diagnostics.mocap_age_s
    mocap = "mocap: no message" if math.isnan(age) else f"mocap: {1e3 * age:.0f} ms old"
    parts = (f"{suite.uptime_s:.0f} s up", suite.flight_text, mocap)
    title = Text(", ".join(part for part in parts if part))
    table = Table(box=SIMPLE_HEAD, title=title, padding=(0, 1, 0, 0))
    for heading in ("node", "state", "loop"):
        table.add_column(heading, no_wrap=True)
    for heading in ("pid", "rate", "p99 late", "missed"):
        table.add_column(heading, justify="right", no_wrap=True)
    faults = []
    for name, node in suite.nodes().items():
        runs = node["pid"] is not None
        if runs and node["level"]:
            faults.append(Text(f"{name}: {node['faults']}", _FAULT_STYLES[min(node["level"], 2)]))
        state = Text(node["state"], _STYLES.get(node["state"], "bold red"))
        head = Text(name, "bold"), state
        loops = node["loops"] if runs and node["loops"] else {"": {}}
        pid = str(node["pid"]) if runs else ""
        for loop, figures in loops.items():
            table.add_row(*head, "" if len(loops) == 1 else loop, pid, *_cells(figures))
            head, pid = (Text(), Text()), ""
    return Group(table, *faults)


def status_line(suite: SuiteState) -> str:
    """Return the suite in one line: number of running nodes, and faults."""
    nodes = suite.nodes()
    running = [node for node in nodes.values() if node["pid"] is not None]
    figures = [figure(loop, "missed") for node in running for loop in node["loops"].values()]
    missed = sum(int(number) for number in figures if not math.isnan(number))
    line = f"{suite.uptime_s:.0f} s: {len(running)} of {len(nodes)} nodes run, {missed} missed"
    troubles = []
    for name, node in nodes.items():
        if node["state"] != "running":
            troubles.append(f"{name} {node['state']}")
        elif node["level"]:
            troubles.append(f"{name}: {node['faults']}")
    return "; ".join([line, *([suite.flight_text] if suite.flights else []), *troubles])


def status_object(suite: SuiteState) -> dict[str, Any]:
    """Return the suite as plain values."""
    several = {name: _flight_object(*known) for name, known in suite.flights.items() if name}
    return {
        "event": "status",
        "uptime_s": round(suite.uptime_s, 1),
        **_flight_object(*suite.flights.get("", ({}, 0.0))),
        **({"vehicles": several} if several else {}),
        "nodes": suite.nodes(),
    }


def _flight_object(flight: Mapping[str, Any], age_s: float) -> dict[str, Any]:
    return {
        "phase": _phase(flight) or None,
        "height_m": flight.get("height_m"),
        "height_age_s": round(age_s, 1) if flight else None,
    }


def _phase(flight: Mapping[str, Any]) -> str:
    phase = flight.get("phase")
    return "" if phase is None else PHASE_NAMES[phase].replace("_", " ")


def _cells(loop: Mapping[str, Any]) -> tuple[Text, ...]:
    rate, late, missed = (figure(loop, key) for key in ("rate_hz", "jitter_p99_us", "missed"))
    return (
        Text("" if math.isnan(rate) else f"{rate:.1f} Hz"),
        Text("" if math.isnan(late) else lateness_text(late)),
        Text("" if math.isnan(missed) else f"{missed:.0f}", "yellow" if missed > 0 else ""),
    )

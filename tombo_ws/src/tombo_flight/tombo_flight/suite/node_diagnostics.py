"""What nodes say of themselves on `/diagnostics`: vitals in flight, and figures of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.recording import Recording
from tombo_bag.schemas import type_store
from tombo_bag.topics import DIAGNOSTICS
from tombo_dynamics.time_base import LATENESS_MAX_US
from tombo_flight.suite.nodes import SUITE

SILENT_S: Final = 3.0
"""A node that reports each second is called silent after this time."""
MOCAP_AGE: Final = "mocap_age_s"
"""Key of the age of the newest pose, in the report of the nodes that take poses."""


@dataclass(frozen=True)
class NodeStatus:
    """The last report of a node.

    Attributes:
        level: 0 well, 1 warning, 2 error.
        message: the fault; empty without one.
        values: figures by name, as numbers where possible.
        loops: figures of its loops over its whole life, by the loop's name, as `rate loop`.
        heard_s: time of arrival [s], on the clock of the receiver.
    """

    level: int = 0
    message: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    loops: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    heard_s: float = -math.inf


def figure(loop: Mapping[str, Any], key: str) -> float:
    """Return a figure of a loop, NaN if it was not reported."""
    value = loop.get(key)
    return float(value) if isinstance(value, int | float) else math.nan


def lateness_text(late_us: float) -> str:
    """Return a percentile of the lateness for people: `140 us`, or `> 20 ms` if it was clipped."""
    if late_us >= LATENESS_MAX_US:
        return f"> {1e-3 * LATENESS_MAX_US:.0f} ms"
    return f"{late_us:.0f} us"


def plain_status(status: Any) -> dict[str, Any]:
    """Return a diagnostic_msgs/DiagnosticStatus as plain values."""
    level = status.level
    return {
        "name": status.name,
        "level": level[0] if isinstance(level, bytes) else int(level),
        "message": status.message,
        "values": {pair.key: pair.value for pair in status.values},
    }


class NodeDiagnostics:
    """Collects reports; `nodes` has the last one of each node."""

    def __init__(self) -> None:
        self.nodes: dict[str, NodeStatus] = {}

    def take(self, report: Iterable[Mapping[str, Any]], heard_s: float, vehicle: str = "") -> None:
        """Take in one report: the statuses of a DiagnosticArray.

        Args:
            report: each status with name (`NODE` or `NODE: LOOP`), level, message, values.
            heard_s: when it came; any clock that goes on.
            vehicle: whose nodes they are, of several: they are called VEHICLE/NODE.
        """
        heads: dict[str, Mapping[str, Any]] = {}
        loops: dict[str, dict[str, Any]] = {}
        for status in report:
            node, _, loop = str(status["name"]).partition(": ")
            if loop:
                loops.setdefault(node, {})[loop] = _numbers(status["values"])
            else:
                heads[node] = status
        for node in {**heads, **loops}:
            head = heads.get(node, {})
            level = int(head.get("level", 0))
            self.nodes[f"{vehicle}/{node}" if vehicle else node] = NodeStatus(
                level,
                str(head.get("message", "")) if level else "",
                _numbers(head.get("values", {})),
                loops.get(node, {}),
                heard_s,
            )

    @property
    def mocap_age_s(self) -> float:
        """Age of the newest pose as the node knows it that has it freshest; NaN: unknown."""
        ages = [status.values.get(MOCAP_AGE) for status in self.nodes.values()]
        return min((float(age) for age in ages if isinstance(age, int | float)), default=math.nan)


def _numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Turn texts that are numbers into numbers: whole ones into int."""
    return {str(key): _number(value) for key, value in values.items()}


def _number(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value


_METRIC_KEYS = ("rate_hz", "jitter_p50_us", "jitter_p99_us", "missed")
_OWN_LOOP = "loop"
"""The loop that every node has. A node with more of them is told by those."""
_RECORDER = "recorder"
_MISSED_MAX = 0.01
"""Share of its runs that a loop may miss."""


def recorded_diagnostics(recording: Recording) -> NodeDiagnostics:
    """Return the last report of each node; of several vehicles they are called VEHICLE/NODE."""
    node_diagnostics = NodeDiagnostics()
    store: Any = type_store()
    for topic in [name for name in recording.topics if name.endswith(DIAGNOSTICS.name)]:
        vehicle = topic.removesuffix(DIAGNOSTICS.name).strip("/")
        for data in recording.messages(topic).messages:
            report = store.deserialize_cdr(data, DIAGNOSTICS.typename)
            node_diagnostics.take(map(plain_status, report.status), 0.0, vehicle)
    return node_diagnostics


def node_metrics(recording: Recording) -> dict[str, Any]:
    """Return the loops, the latency through all nodes and the recorder's count, for a summary.

    Values not reported are None. In lockstep no loop runs by a clock, and none is returned. The
    latency of several vehicles is that of the first.
    """
    node_diagnostics = recorded_diagnostics(recording)
    loops = dict(_loops(node_diagnostics))
    notes = recording.metadata.get(RECORDER_METADATA, {})
    simulators = [name for name in node_diagnostics.nodes if name.rpartition("/")[2] == "sim"]
    sim = node_diagnostics.nodes[min(simulators)].values if simulators else {}
    return {
        "loops": {
            name: {key: loop.get(key) for key in _METRIC_KEYS} for name, loop in loops.items()
        },
        "latency_gyro_to_command_us": {
            share: sim.get(f"latency_gyro_to_command_{share}_us") for share in ("p50", "p99")
        },
        "recorder": {
            key: int(notes[key]) if notes.get(key, "").isdecimal() else None
            for key in ("messages", "lost")
        }
        | {"lost_on": _lost_on(notes)},
        "too_slow": too_slow(loops, notes.get("lost", "")),
    }


def too_slow(loops: Mapping[str, Mapping[str, Any]], lost: str) -> list[str]:
    """Return in which ways the machine was too slow for the figures of a flight in real time.

    A loop must begin 99 % of its runs within its period, and miss no more than 1 % of them. The
    recorder's loop only empties queues of seconds: of it, no message may be lost.

    Args:
        loops: name → figures; figures that were not reported count as good.
        lost: how many messages the recorder lost, as it wrote it.
    """
    found = []
    for name, loop in loops.items():
        if name == _RECORDER:
            continue
        names = ("jitter_p99_us", "rate_hz", "runs", "missed")
        late, rate, runs, missed = (figure(loop, name) for name in names)
        asked = runs + missed
        period_us = 1e6 * runs / (rate * asked) if rate * asked > 0.0 else math.nan
        if late > period_us:
            found.append(
                f"{name} {lateness_text(late)} late at 99 % (period {1e-3 * period_us:.0f} ms)"
            )
        elif missed > _MISSED_MAX * asked:
            found.append(f"{name} missed {100.0 * missed / asked:.1f} % of its runs")
    if lost.isdecimal() and int(lost):
        found.append(f"{lost} messages lost in the recording")
    return found


def _lost_on(notes: Mapping[str, str]) -> dict[str, int]:
    """Return how many messages the recorder lost on each topic that lost some."""
    marked = {key.removeprefix("lost:"): n for key, n in notes.items() if key.startswith("lost:")}
    return {topic: int(n) for topic, n in marked.items() if n.isdecimal() and int(n)}


def _loops(node_diagnostics: NodeDiagnostics) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield (name, figures): those of the controller by their own names, others by the node's."""
    order = {name: number for number, name in enumerate(SUITE)}

    def place(node: str) -> tuple[str, int]:
        vehicle, _, name = node.rpartition("/")
        return vehicle, order.get(name, len(order))

    for node in sorted(node_diagnostics.nodes, key=place):
        status, vehicle = node_diagnostics.nodes[node], node.rpartition("/")[0]
        own = {name: loop for name, loop in status.loops.items() if name != _OWN_LOOP}
        for name, loop in (own or status.loops).items():
            if loop.get("runs") != 0:
                loop_name = f"{vehicle}/{name}".strip("/").removesuffix(" loop")
                yield (loop_name if own else node), loop

"""Loop rates and latencies of a recorded flight's nodes, from `/diagnostics`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from tombo_bag.formats.rolling_sink import NOTES
from tombo_bag.recording import Recording
from tombo_bag.schemas import type_store
from tombo_bag.topics import DIAGNOSTICS
from tombo_flight.suite.node_diagnostics import Loop, NodeDiagnostics, lateness_text
from tombo_flight.suite.nodes import SUITE

_METRIC_KEYS = ("rate_hz", "jitter_p50_us", "jitter_p99_us", "missed")
_OWN_LOOP = "loop"
"""The loop that every node has. A node with more of them is told by those."""
_RECORDER = "recorder"
_MISSED_MAX = 0.01
"""Share of its runs that a loop may miss."""


def recorded_diagnostics(recording: Recording) -> NodeDiagnostics:
    """Return the last report of each node."""
    node_diagnostics = NodeDiagnostics()
    there = DIAGNOSTICS.name in recording.topics
    store: Any = type_store()
    for data in recording.messages(DIAGNOSTICS.name).messages if there else ():
        report = store.deserialize_cdr(data, DIAGNOSTICS.typename)
        statuses = [
            {
                "name": status.name,
                "level": status.level,
                "message": status.message,
                "values": {pair.key: pair.value for pair in status.values},
            }
            for status in report.status
        ]
        node_diagnostics.take(statuses, 0.0)
    return node_diagnostics


def node_metrics(recording: Recording) -> dict[str, Any]:
    """Return the loops, the latency through all nodes and the recorder's count, for a summary.

    What was not reported is None. In lockstep no loop runs by a clock, and none is returned.
    """
    node_diagnostics = recorded_diagnostics(recording)
    loops = dict(_loops(node_diagnostics))
    notes = recording.metadata.get(NOTES, {})
    sim = node_diagnostics.nodes["sim"].values if "sim" in node_diagnostics.nodes else {}
    return {
        "loops": {
            name: {key: loop.metrics.get(key) for key in _METRIC_KEYS}
            for name, loop in loops.items()
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


def too_slow(loops: Mapping[str, Loop], lost: str) -> list[str]:
    """Return in which ways the machine was too slow for the figures of a flight in real time.

    A loop must begin 99 % of its runs within its period, and miss no more than 1 % of them. The
    recorder's loop only empties queues of seconds: of it, no message may be lost.

    Args:
        loops: name → loop; figures that were not reported count as good.
        lost: how many messages the recorder lost, as it wrote it.
    """
    found = []
    for name, loop in loops.items():
        if name == _RECORDER:
            continue
        late, rate, runs, missed = map(loop.number, ("jitter_p99_us", "rate_hz", "runs", "missed"))
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


def _loops(node_diagnostics: NodeDiagnostics) -> Iterator[tuple[str, Loop]]:
    """Yield (name, loop): those of the controller by their own names, others by the node's."""
    order = {node: place for place, node in enumerate(SUITE)}
    known = sorted(node_diagnostics.nodes.items(), key=lambda item: order.get(item[0], len(order)))
    for node, status in known:
        own = [loop for loop in status.loops if loop.name != _OWN_LOOP]
        for loop in own or status.loops:
            if loop.metrics.get("runs") == 0:
                continue
            yield (loop.name.removesuffix(" loop") if own else node), loop

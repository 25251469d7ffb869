"""How well the nodes of a recorded flight kept their time: what they said on `/diagnostics`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tombo_bag.recording import Recording
from tombo_bag.rolling_sink import NOTES
from tombo_bag.schemas import type_store
from tombo_bag.topics import DIAGNOSTICS
from tombo_flight.suite.nodes import SUITE
from tombo_flight.suite.vitals import Loop, Vitals

_FIGURES = ("rate_hz", "jitter_p50_us", "jitter_p99_us", "missed")
_OWN_LOOP = "loop"
"""The loop that every node has. A node with more of them is told by those."""


def recorded_vitals(recording: Recording) -> Vitals:
    """Return the last report of each node."""
    vitals = Vitals()
    for report in _reports(recording):
        vitals.take(report, 0.0)
    return vitals


def node_figures(recording: Recording) -> dict[str, Any]:
    """Return the loops, the latency through all nodes and the recorder's count, for a summary.

    What nobody told is None.
    """
    vitals = recorded_vitals(recording)
    notes = recording.metadata.get(NOTES, {})
    sim = vitals.nodes["sim"].values if "sim" in vitals.nodes else {}
    return {
        "loops": {
            name: {key: loop.figures.get(key) for key in _FIGURES} for name, loop in _loops(vitals)
        },
        "latency_gyro_to_command_us": {
            share: sim.get(f"latency_gyro_to_command_{share}_us") for share in ("p50", "p99")
        },
        "recorder": {
            key: int(notes[key]) if notes.get(key, "").isdecimal() else None
            for key in ("messages", "lost")
        },
    }


def _loops(vitals: Vitals) -> Iterator[tuple[str, Loop]]:
    """Yield (name, loop): those of the controller by their own names, others by the node's."""
    order = {node: place for place, node in enumerate(SUITE)}
    known = sorted(vitals.nodes.items(), key=lambda item: order.get(item[0], len(order)))
    for node, status in known:
        own = [loop for loop in status.loops if loop.name != _OWN_LOOP]
        for loop in own or status.loops:
            yield (loop.name.removesuffix(" loop") if own else node), loop


def _reports(recording: Recording) -> Iterator[list[dict[str, Any]]]:
    if DIAGNOSTICS.name not in recording.topics:
        return
    store = type_store()
    for data in recording.messages(DIAGNOSTICS.name).messages:
        array: Any = store.deserialize_cdr(data, DIAGNOSTICS.typename)
        yield [
            {
                "name": status.name,
                "level": status.level,
                "message": status.message,
                "values": {pair.key: pair.value for pair in status.values},
            }
            for status in array.status
        ]

"""What happened in a flight, as messages: collision events, status changes, markers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight_time import nanoseconds, stamp
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase, ReactionPhase, Trigger
from tombo_dynamics.time_base import EPOCH_NS

NAN = float("nan")
NO_POINT = (NAN, NAN, NAN)
TRIGGERS = {trigger.name.lower(): int(trigger) for trigger in Trigger}
PHASES = {int(phase): phase.name.lower() for phase in Phase}
MARKER_SPHERE, MARKER_CYLINDER = 2, 3
POINT_DIAMETER_M = 0.12
"""How large x_c and x_r are drawn."""


@dataclass
class EventMessages:
    """Messages of one topic: log times and bytes."""

    topic: str
    typename: str
    times_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    messages: list[bytes] = field(default_factory=list)

    def add(self, time_ns: int, values: Mapping[str, Any]) -> None:
        """Append a message."""
        self.times_ns = np.append(self.times_ns, np.int64(time_ns))
        self.messages.append(encode(self.typename, values))


def event_messages(
    events: Sequence[Mapping[str, Any]],
    scenario: Mapping[str, Any],
    ticks_s: Array,
    phases: NDArray[np.int64] | None,
) -> Iterator[EventMessages]:
    """Build the messages of all topics that speak only when something happens.

    Args:
        events: of the flight; `detection` with stamp_s (capture), x_c_m and more,
            `setpoint_switch` with x_c_m, x_r_m, n_r; a missing value becomes NaN or 0.
        scenario: as flown; its obstacle is drawn.
        ticks_s: (N,) s.
        phases: (N,) phase of the flight per tick, or None.
    """
    ordered = sorted(events, key=lambda event: float(event["time_s"]))
    changes = _phase_changes(ticks_s, phases)
    yield _collisions(ordered)
    yield _reactions(ordered, changes)
    yield _phases(changes)
    yield _markers(ordered, scenario)


def _collisions(events: Sequence[Mapping[str, Any]]) -> EventMessages:
    out = EventMessages("/collision_event", "tombo_msgs/msg/CollisionEvent")
    for count, event in enumerate(_of_kind(events, "detection"), start=1):
        contact = event.get("contact_time_s")
        out.add(
            _time_ns(event),
            {
                "header": _header(nanoseconds(event.get("stamp_s", event["time_s"]))),
                "trigger": TRIGGERS.get(str(event.get("trigger")), 0),
                "contact_stamp": stamp(0 if contact is None else int(nanoseconds(contact))),
                "contact_position": _xyz(event.get("x_c_m")),
                "flight_direction": _xyz(event.get("flight_direction")),
                "confidence": _number(event, "confidence"),
                "statistic": _number(event, "statistic"),
                "count": int(event.get("count", count)),
            },
        )
    return out


def _reactions(
    events: Sequence[Mapping[str, Any]], changes: Sequence[tuple[int, int]]
) -> EventMessages:
    out = EventMessages("/reaction/status", "tombo_msgs/msg/ReactionStatus")
    switches = [(_time_ns(event), event) for event in _of_kind(events, "setpoint_switch")]
    blind = [(time, None) for time, phase in changes if phase == Phase.DESCEND_BLIND]
    nothing: Mapping[str, Any] = {}
    latest, count = nothing, 0

    def say(time_ns: int, state: int) -> None:
        out.add(
            time_ns,
            {
                "header": _header(time_ns),
                "state": state,
                "x_c": _xyz(latest.get("x_c_m")),
                "x_r": _xyz(latest.get("x_r_m")),
                "n_r": _xyz(latest.get("n_r")),
                "collisions": count,
            },
        )

    say(EPOCH_NS, ReactionPhase.IDLE)
    for time_ns, switch in sorted([*switches, *blind], key=lambda item: item[0]):
        if switch is not None:
            latest, count = switch, int(switch.get("count", count + 1))
        say(time_ns, ReactionPhase.BLIND if switch is None else ReactionPhase.REACTING)
    return out


def _phases(changes: Sequence[tuple[int, int]]) -> EventMessages:
    out = EventMessages("/mission/status", "tombo_msgs/msg/MissionStatus")
    for time_ns, phase in changes:
        word = PHASES.get(phase, str(phase))
        out.add(time_ns, {"header": _header(time_ns), "phase": phase, "text": word})
    return out


def _phase_changes(ticks_s: Array, phases: NDArray[np.int64] | None) -> list[tuple[int, int]]:
    """List (time [ns], new phase), beginning with the first tick's phase."""
    if phases is None or not len(phases):
        return []
    ticks = np.concatenate([[0], np.flatnonzero(phases[1:] != phases[:-1]) + 1])
    return list(zip(nanoseconds(ticks_s[ticks]).tolist(), phases[ticks].tolist(), strict=True))


def _markers(events: Sequence[Mapping[str, Any]], scenario: Mapping[str, Any]) -> EventMessages:
    out = EventMessages("/markers", "visualization_msgs/msg/MarkerArray")
    obstacle = scenario.get("obstacle") or {}
    if {"x_m", "y_m", "radius_m", "top_m"} <= set(obstacle):
        height, diameter = float(obstacle["top_m"]), 2.0 * float(obstacle["radius_m"])
        marker = _marker(
            EPOCH_NS,
            "obstacle",
            MARKER_CYLINDER,
            (float(obstacle["x_m"]), float(obstacle["y_m"]), 0.5 * height),
            (diameter, diameter, height),
            (0.6, 0.6, 0.65, 0.8),
        )
        out.add(EPOCH_NS, {"markers": [marker]})
    for event in events:
        if event.get("kind") == "detection":
            point, name, colour = event.get("x_c_m"), "x_c", (0.9, 0.2, 0.15, 1.0)
        elif event.get("kind") == "setpoint_switch":
            point, name, colour = event.get("x_r_m"), "x_r", (0.1, 0.6, 0.3, 1.0)
        else:
            continue
        if point is not None and np.isfinite(np.asarray(point, np.float64)).all():
            size = (POINT_DIAMETER_M,) * 3
            time_ns = _time_ns(event)
            marker = _marker(time_ns, name, MARKER_SPHERE, tuple(point), size, colour)
            out.add(time_ns, {"markers": [marker]})
    return out


def _marker(
    time_ns: int,
    name: str,
    shape: int,
    position: Sequence[float],
    scale: Sequence[float],
    colour: Sequence[float],
) -> dict[str, Any]:
    return {
        "header": _header(time_ns),
        "ns": name,
        "type": shape,
        "pose": {"position": _xyz(position), "orientation": {"w": 1.0}},
        "scale": _xyz(scale),
        "color": dict(zip("rgba", colour, strict=True)),
        "frame_locked": True,
        "text": name,
    }


def _of_kind(events: Sequence[Mapping[str, Any]], kind: str) -> list[Mapping[str, Any]]:
    return [event for event in events if event.get("kind") == kind]


def _time_ns(event: Mapping[str, Any]) -> int:
    return int(nanoseconds(event["time_s"]))


def _number(event: Mapping[str, Any], key: str) -> float:
    value = event.get(key)
    return NAN if value is None else float(value)


def _header(time_ns: Any) -> dict[str, Any]:
    return {"stamp": stamp(int(time_ns)), "frame_id": "map"}


def _xyz(values: Any) -> dict[str, float]:
    given = NO_POINT if values is None else values
    return dict(zip("xyz", (float(value) for value in given), strict=True))

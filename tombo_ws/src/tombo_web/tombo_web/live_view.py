"""The live page's view of the newest messages: a row for the 3-D scene, values, changes.

World `map` ENU, body `base_link` FLU, SI units, quaternions xyzw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from enum import IntEnum
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np

from tombo_bag.message_codec import FORMS
from tombo_bag.topics import (
    COLLISION_EVENT,
    CONTACT_EVENT,
    DIAGNOSTICS,
    MISSION_STATUS,
    MOCAP_POSE,
    ODOMETRY,
    PX4_STATUS,
    REACTION_STATUS,
    ROTOR_COMMAND,
    SETPOINT,
    TOPICS,
    TRUE_CONTACT,
    TRUE_ODOMETRY,
    TRUE_ROTORS,
)
from tombo_dynamics.message_records import record_of
from tombo_dynamics.messages import Phase, ReactionPhase, Trigger
from tombo_dynamics.rotation import body_to_map

SCENE: Final = {
    "position": (3, ((TRUE_ODOMETRY.name, "position"), (MOCAP_POSE.name, "position"))),
    "velocity": (3, ()),
    "attitude": (4, ((TRUE_ODOMETRY.name, "attitude"), (MOCAP_POSE.name, "attitude"))),
    "rates": (3, ((TRUE_ODOMETRY.name, "rates"), (ODOMETRY.name, "rates"))),
    "position_setpoint": (3, ((SETPOINT.name, "position"),)),
    "est_position": (3, ((ODOMETRY.name, "position"),)),
    "rotor_thrust": (4, ((TRUE_ROTORS.name, "thrust"),)),
    "rotor_speed": (4, ((TRUE_ROTORS.name, "speed"), (ROTOR_COMMAND.name, "speed"))),
    "fold": (4, ((TRUE_ROTORS.name, "fold"),)),
    "damage": (4, ((TRUE_ROTORS.name, "damage"),)),
    "mode": (1, ((MISSION_STATUS.name, "phase"),)),
    "contact_N": (1, ()),
}
"""Column of the scene → width, and topic and field from which it comes, the best first."""
STALE_POSE_S: Final = 0.2
"""Poses of the motion capture that are silent for this time are a fault."""
_LEVELS: Final = ("ok", "warning", "error", "stale")
_AXES: Final = {2: "xy", 3: "xyz", 4: "xyzw"}
_NOT_SHOWN: Final = ("stamp_ns", "frame_id", "pose_covariance", "twist_covariance")
_DIGITS: Final = 5
_POSES: Final = "poses of the motion capture"


class TopicMessage(NamedTuple):
    """A message, whatever it came from."""

    topic: str
    fields: Mapping[str, Any]
    """Values by the names of the message's dataclass, else of its definition."""
    time_s: float
    """Time of capture, on the clock of the source."""
    arrival_s: float
    """When it came, same clock."""


class LiveView:
    """The newest values of every topic, and their changes since the last frame."""

    def __init__(self) -> None:
        self.signals: dict[str, float] = {}
        """Every number that has come, by topic, field and component, as `/odometry.position.x`."""
        self._latest: dict[str, Mapping[str, Any]] = {}
        self._changes: list[dict[str, Any]] = []
        self._told: dict[str, Any] = {}
        self._contact_n = 0.0
        self._pose_arrival_s = self._latency_s = math.nan

    def units(self) -> dict[str, str]:
        """Return the name of every signal → its unit; empty where the type says none."""
        return {name: _unit(name) for name in sorted(self.signals)}

    def begins_again(self, message: TopicMessage) -> bool:
        """Return whether a message is of another flight: a mission waits that was under way."""
        waits = message.topic == MISSION_STATUS.name and int(message.fields["phase"]) == Phase.IDLE
        before = self._latest.get(MISSION_STATUS.name)
        return waits and before is not None and int(before["phase"]) != Phase.IDLE

    def take(self, message: TopicMessage) -> None:
        """Note a message."""
        topic, fields = message.topic, message.fields
        self._latest[topic] = fields
        self.signals.update(_numbers(topic, fields))
        if topic == TRUE_CONTACT.name and fields["in_contact"]:
            self._contact_n = max(self._contact_n, float(np.linalg.norm(fields["force"])))
        elif topic == MOCAP_POSE.name:
            self._pose_arrival_s = message.arrival_s
            self._latency_s = message.arrival_s - message.time_s
        for key, kind, text in _statements(topic, fields):
            self._tell(key, kind, text, message.time_s)

    def frame(self, now_s: float, picked: Iterable[str]) -> dict[str, Any]:
        """Return the values to show now, as plain values for JSON; changes are given once.

        Args:
            now_s: time of the source [s].
            picked: names of the signals that are drawn as curves.
        """
        silent = now_s - self._pose_arrival_s > STALE_POSE_S
        if not math.isnan(self._pose_arrival_s):
            text = "none" if silent else "come again"
            self._tell(_POSES, "fault", text, now_s, first="come again")
        changes, self._changes = self._changes, []
        row, self._contact_n = self._row(), 0.0
        return {
            "t": round(now_s, 4),
            "row": [_plain(x) for x in row],
            "values": {name: _plain(self.signals.get(name, math.nan)) for name in picked},
            "changes": changes,
            "pose": {
                "latency_ms": _plain(1e3 * self._latency_s),
                "age_ms": _plain(1e3 * (now_s - self._pose_arrival_s)),
                "silent": bool(silent),
            },
            "state": {key: text for key, (_, text) in self._told.items() if key != _POSES},
            "marks": self._marks(),
        }

    def _tell(self, key: str, kind: str, text: str, time_s: float, first: str = "") -> None:
        """Note what is said of a thing, and that it has changed."""
        before = self._told.get(key, ("", first))[1]
        self._told[key] = (kind, text)
        if text != before:
            change = {"time_s": round(time_s, 3), "kind": kind, "of": key, "text": text}
            self._changes.append(change)

    def _row(self) -> list[float]:
        row: list[float] = []
        attitude = self._value("attitude")
        for name, (width, _) in SCENE.items():
            if name == "velocity":
                values = self._velocity(attitude)
            elif name == "contact_N":
                values = np.array([self._contact_n])
            else:
                values = self._value(name)
            row += np.resize(values, width).tolist()
        return row

    def _value(self, name: str) -> Any:
        """Return a column of the scene; 0 for unknown values, upright for the attitude."""
        width, sources = SCENE[name]
        for topic, field in sources:
            value = self._latest.get(topic, {}).get(field)
            if value is not None:
                return np.atleast_1d(np.asarray(value, dtype=np.float64))
        return np.array((0.0, 0.0, 0.0, 1.0)) if name == "attitude" else np.zeros(width)

    def _velocity(self, attitude: Any) -> Any:
        for topic in (TRUE_ODOMETRY.name, ODOMETRY.name):
            velocity = self._latest.get(topic, {}).get("velocity")
            if velocity is not None:
                return body_to_map(attitude[None, :], np.asarray(velocity)[None, :])[0]
        return np.zeros(3)

    def _marks(self) -> dict[str, Any]:
        """Return x_c, n_r, x_r of the reaction [m, map ENU]; None while there are none."""
        fields = self._latest.get(REACTION_STATUS.name, {})
        marks = {}
        for name, key in (("x_c", "x_c_m"), ("x_r", "x_r_m"), ("n_r", "n_r")):
            value = np.asarray(fields.get(name, (math.nan,) * 3), dtype=np.float64)
            marks[key] = [_plain(x) for x in value] if np.isfinite(value).all() else None
        return marks


@cache
def _unit(signal: str) -> str:
    """Return the unit of a signal by the dataclass of its topic's messages."""
    topic, _, field = signal.partition(".")
    form = FORMS.get(TOPICS[topic].typename) if topic in TOPICS else None
    known = None if form is None else record_of(form).fields.get(field.partition(".")[0])
    return known.unit if known is not None and known.unit != "1" else ""


def _numbers(topic: str, fields: Mapping[str, Any]) -> dict[str, float]:
    """Return every number of a message by its name."""
    numbers: dict[str, float] = {}
    for name, value in fields.items():
        if name in _NOT_SHOWN or isinstance(value, str):
            continue
        values = np.asarray(value)
        if values.dtype.kind not in "fiub" or values.ndim > 1 or values.size > 16:
            continue
        if values.ndim == 0:
            numbers[f"{topic}.{name}"] = float(values)
            continue
        axes = "0123456789" if topic in _OF_ROTORS else _AXES.get(values.size, "")
        for k, x in enumerate(values.tolist()):
            part = axes[k] if k < len(axes) else str(k)
            numbers[f"{topic}.{name}.{part}"] = float(x)
    return numbers


_OF_ROTORS = (TRUE_ROTORS.name, ROTOR_COMMAND.name)


def _statements(topic: str, fields: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the text of a status or an event: of what, its kind, the text after that."""
    if topic == MISSION_STATUS.name:
        return [("phase", "phase", _name(Phase, fields["phase"]))]
    if topic == REACTION_STATUS.name:
        return [("reaction", "reaction", _name(ReactionPhase, fields["state"]))]
    if topic in (COLLISION_EVENT.name, CONTACT_EVENT.name):
        seen_by, number = _name(Trigger, fields["trigger"]), int(fields["count"])
        text = f"number {number}, {seen_by}, confidence {fields['confidence']:.2f}"
        return [(topic.strip("/").replace("_", " "), "collision", text)]
    if topic == PX4_STATUS.name:
        armed = "armed" if fields.get("armed") else "disarmed"
        words = [f"{fields.get('mode', '')}, {armed}, {fields.get('stage', '')}"]
        words += [str(fields[key]) for key in ("why", "status_text") if fields.get(key)]
        return [("PX4", "px4", "; ".join(words))]
    if topic == DIAGNOSTICS.name:
        return [
            (f"node {name}", "fault", f"{_LEVELS[level]}, {text}")
            if level
            else (f"node {name}", "node", "ok")
            for name, level, text in fields["nodes"]
        ]
    return []


def _name(kind: type[IntEnum], value: Any) -> str:
    """Return a constant of a message in words; an unknown one as its number."""
    try:
        return kind(int(value)).name.lower().replace("_", " ")
    except ValueError:
        return str(value)


def _plain(x: float) -> float | None:
    return round(float(x), _DIGITS) if math.isfinite(x) else None

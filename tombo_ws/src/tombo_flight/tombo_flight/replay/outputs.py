"""What nodes say, recorded or replayed, in one form that can be compared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable
from tombo_bag.recording import Recording
from tombo_dynamics.arrays import Array
from tombo_flight.replay.poses import vectors

Times = NDArray[np.int64]

TRIGGER_NAMES = {1: "region", 2: "innovation"}
"""Constants of tombo_msgs/CollisionEvent."""


@dataclass(frozen=True)
class Event:
    """A detected collision."""

    stamp_ns: int
    """Capture time of the pose that triggered."""
    known_ns: int
    """When it was known: arrival of that pose, or log time of the recorded event."""
    trigger: str
    x_c: tuple[float, float, float]
    contact_ns: int
    statistic: float
    flight_direction: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    confidence: float = math.nan


@dataclass(frozen=True)
class Series:
    """A quantity over time, by the header's stamp: N stamps and (N, k) values."""

    stamp_ns: Times
    values: Array


@dataclass
class Outputs:
    """What was said, as far as it was: events in order of time, series by name."""

    events: list[Event] | None = None
    """None: nobody recorded events (no topic); a list without elements: there were none."""
    series: dict[str, Series] = field(default_factory=dict)


@dataclass(frozen=True)
class Source:
    """Where a series is recorded: topic, fields (`a:xyz` stands for a.x, a.y, a.z), columns."""

    topic: str
    field: str
    width: int

    def empty(self) -> Series:
        """Return a series without samples."""
        return Series(np.zeros(0, np.int64), np.zeros((0, self.width)))


SERIES: dict[str, Source] = {
    "statistic": Source("/detector/status", "statistic", 1),
    "setpoint": Source("/setpoint", "position:xyz", 3),
    "mission_setpoint": Source("/mission/setpoint", "position:xyz", 3),
    "phase": Source("/mission/status", "phase", 1),
    "reaction_state": Source("/reaction/status", "state", 1),
    "x_r": Source("/reaction/status", "x_r:xyz", 3),
    "odometry_position": Source("/odometry", "pose.pose.position:xyz", 3),
    "odometry_attitude": Source("/odometry", "pose.pose.orientation:xyzw", 4),
    "odometry_velocity": Source("/odometry", "twist.twist.linear:xyz", 3),
    "rotor_command": Source("/rotor_command", "speed", 4),
}
"""Series by name."""
EVENTS = "/collision_event"


def read_outputs(recording: Recording, names: Sequence[str]) -> Outputs:
    """Read what a recording holds of some series, and of the events if `events` is named."""
    topics = recording.topics
    found = Outputs()
    if "events" in names and EVENTS in topics:
        found.events = read_events(recording.columns(EVENTS))
    for name in names:
        source = SERIES.get(name)
        if source is not None and source.topic in topics and topics[source.topic].count:
            found.series[name] = read_series(recording.columns(source.topic), source)
    return found


def read_events(table: ColumnTable) -> list[Event]:
    """Read messages of tombo_msgs/CollisionEvent."""
    if "trigger" not in table:
        return []
    contact = table["contact_stamp.sec"].astype(np.int64) * 1_000_000_000
    contact = contact + table["contact_stamp.nanosec"]
    rows = zip(
        table["stamp_ns"].tolist(),
        table["log_time_ns"].tolist(),
        [TRIGGER_NAMES.get(number, str(number)) for number in table["trigger"].tolist()],
        map(tuple, vectors(table, "contact_position").tolist()),
        contact.tolist(),
        table["statistic"].tolist(),
        map(tuple, vectors(table, "flight_direction").tolist()),
        table["confidence"].tolist(),
        strict=True,
    )
    return [Event(*row) for row in rows]


def read_series(table: ColumnTable, source: Source) -> Series:
    """Read a series from its topic's columns."""
    path, _, axes = source.field.partition(":")
    if axes:
        return Series(table["stamp_ns"], vectors(table, path, axes))
    if path not in table:
        return source.empty()
    return Series(table["stamp_ns"], table[path].astype(np.float64).reshape(-1, source.width))

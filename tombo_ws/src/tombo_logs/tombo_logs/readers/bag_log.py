"""A flight from a recording of ROS messages: MCAP, SQLite or ROS 1, file or folder.

Ground truth is never read, even where it is recorded.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tombo_bag.channels import ALL_CHANNELS, ROTOR_SPEED
from tombo_bag.columns import ColumnTable
from tombo_bag.flight import Finding, Flight, Series, damage_findings
from tombo_bag.message_codec import fields_of
from tombo_bag.recording import Recording
from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    BATTERY,
    IMU,
    MOCAP_POSE,
    ODOMETRY,
    POSE_TYPES,
    RATES_SETPOINT,
    ROTOR_COMMAND,
    SETPOINT,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_logs.readers.csv_mapping import ATTITUDES, LogMapping
from tombo_logs.readers.foreign_topics import PX4, ForeignTopics

_TYPES = {
    MOCAP_POSE.name: tuple(POSE_TYPES),
    IMU.name: (IMU.typename,),
    ROTOR_COMMAND.name: (ROTOR_COMMAND.typename,),
    ROTOR_SPEED: (ROTOR_COMMAND.typename,),
    BATTERY.name: (BATTERY.typename,),
}
_CONTROL = {t.name: t.typename for t in (SETPOINT, ATTITUDE_SETPOINT, RATES_SETPOINT, ODOMETRY)}
"""Topic → type of the controller's estimates and set points."""
_POSE = {"position", "attitude"}
_TRUTH = "ground_truth"
_OTHER_CLOCK_S = 30.0
"""Stamps this far from the log's times come from another clock."""


def read_bag(
    path: Path,
    name: str,
    names: Mapping[str, str] | None = None,
    mapping: LogMapping | None = None,
) -> Flight:
    """Read a recording, a file or a folder, under a name for the flight.

    `names`: topic as recorded → name in this suite (`/mocap/pose`, `/imu/data_raw` …). Channels
    of a mapping that name a topic go first, then the suite's topics, then those of other projects.

    Raises:
        InputError: no recording, or none with a pose in it.
    """
    for source, target in (names or {}).items():
        if _TRUTH in source.split("/"):
            raise InputError(f"{source}:={target}: ground truth is what a diagnosis must not see")
    with Recording(path, names or {}) as recording:
        mapped = set() if mapping is None else {k for g in mapping.by_topic.values() for k in g}
        topics = _topics(recording, skip={MOCAP_POSE.name} if _POSE & mapped else set())
        foreign = ForeignTopics(recording, name, mapping)
        if MOCAP_POSE.name not in topics and not {*mapped, *foreign.px4} >= _POSE:
            raise _no_pose(recording)
        control = [t for t, kind in _CONTROL.items() if t in usable_topics(recording, {kind})]
        recording.load([*topics.values(), *control])
        tables = {name: recording.columns(topic) for name, topic in topics.items()}
        asked = {name: recording.columns(name) for name in control}
        typenames = {key: recording.topics[topic].typename for key, topic in topics.items()}
        tables = {key: table for key, table in tables.items() if len(table["log_time_ns"])}
        starts = [s.first_ns for s in recording.topics.values() if s.count]
        metadata = _scenario_name(recording.metadata)
        damage = recording.damage
    findings = damage_findings(name, path, damage)
    used = {key for key, _ in foreign.channels.values()} | ({PX4} if foreign.px4 else set())
    others = {key: foreign.tables[key] for key in used}
    start_ns = min(starts, default=0)
    clock = _Clock(name, start_ns, {**tables, **others})
    series = {key: clock.shifted(PX4, px4_series) for key, px4_series in foreign.px4.items()}
    for channel, (key, values) in foreign.channels.items():
        series[channel] = clock.series(key, others[key], values)
    for key, table in tables.items():
        for channel, values in _values(key, table, typenames[key]).items():
            if channel not in mapped:
                series[channel] = clock.series(key, table, values)
    every = (*findings, *foreign.findings, *clock.findings)
    said = _Clock(name, start_ns, asked)
    for key, table in asked.items():
        for channel, values in _values(key, table, _CONTROL[key]).items():
            series.setdefault(channel, said.series(key, table, values))
    return Flight.measured(
        name, f"{path} (recording)", series, findings=every, metadata=metadata, epoch_ns=start_ns
    )


class _Clock:
    """Turns stamps into seconds since the recording's start."""

    def __init__(self, flight: str, start_ns: int, tables: Mapping[str, ColumnTable]) -> None:
        self.findings: list[Finding] = []
        self._flight = flight
        self._zero: dict[str, int] = {}
        self._arrival_zero = start_ns
        apart = {
            key: float(np.median(table["log_time_ns"] - table["stamp_ns"]))
            for key, table in tables.items()
        }
        limit = _OTHER_CLOCK_S * 1e9
        # simulated or boot time against the recorder's: one shift for all keeps delays as they are
        beyond = [gap for gap in apart.values() if abs(gap) > limit]
        shift = int(np.median(beyond)) if len(beyond) == len(apart) and beyond else 0
        for key, gap in apart.items():
            far = abs(gap - shift) > limit
            self._zero[key] = start_ns - int(gap if far else shift)
            if far:
                text = (
                    f"{key}: stamps are {gap * 1e-9:.1f} s before the times of recording, those "
                    "of other topics not: another clock; shifted so that they agree on average"
                )
                self.findings.append(Finding("stamps", "warning", flight, text, channel=key))

    def series(self, key: str, table: ColumnTable, values: Array) -> Series:
        stamps, zero = table["stamp_ns"], self._zero[key]
        arrival = (table["log_time_ns"] - self._arrival_zero) * 1e-9
        return Series((stamps - zero) * 1e-9, values, np.asarray(arrival))

    def shifted(self, key: str, series: Series) -> Series:
        """Return a series with stamps [s] of a clock as one on the recording's."""
        return Series(series.t - self._zero[key] * 1e-9, series.values)


def _topics(recording: Recording, skip: Collection[str]) -> dict[str, str]:
    """Return our topic → the recorded one: by name, or under a namespace if there is just one."""
    topics: dict[str, str] = {}
    for key, types in _TYPES.items():
        if key in skip:
            continue
        fitting = [topic for topic in usable_topics(recording, types) if topic.endswith(key)]
        if key in fitting:
            topics[key] = key
        elif len(fitting) == 1:
            topics[key] = fitting[0]
        elif fitting:
            raise InputError(
                f"'{recording.path}': {' and '.join(fitting)} could be {key}; accepted: one, "
                f"named with {fitting[0]}:={key}"
            )
    return topics


def usable_topics(recording: Recording, types: Collection[str]) -> list[str]:
    """Return the topics of these types that have messages, without ground truth."""
    return [
        topic
        for topic, stream in recording.topics.items()
        if stream.typename in types and stream.count and _TRUTH not in topic.split("/")
    ]


def _no_pose(recording: Recording) -> InputError:
    poses = usable_topics(recording, POSE_TYPES)
    if poses:
        hint = f"poses are in {', '.join(poses)}: name one as {poses[0]}:={MOCAP_POSE.name}"
    else:
        hint = f"topics there: {', '.join(recording.topics) or 'none'}"
    hint += "".join(f"; {text}" for text in recording.damage)
    return InputError(
        f"'{recording.path}' has no poses of a motion capture; needed: position and attitude, as "
        f"topic {MOCAP_POSE.name}; {hint}"
    )


def _values(key: str, table: ColumnTable, typename: str) -> dict[str, Array]:
    """Return channel → values of one of our topics; `typename` is that of its messages."""
    fields = fields_of(typename, table)
    values: dict[str, Array] = {
        name: np.asarray(fields[channel.field], np.float64).reshape(-1, channel.width)
        for name, channel in ALL_CHANNELS.items()
        if channel.topic == key and channel.field in fields
    }
    for name in set(ATTITUDES) & set(values):
        values[name] = unwrap_quaternions(values[name])
    if key == BATTERY.name:
        values["current"] = -values["current"]  # sensor_msgs: drawn is negative
        return {name: v for name, v in values.items() if np.isfinite(v).any()}
    return values


def _scenario_name(metadata: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """Return the scenario's name, and nothing else: its effects would be the solution."""
    try:
        scenario: Any = json.loads(metadata["tombo_flight"]["scenario"])
        return {"scenario": str(scenario["name"])}
    except (KeyError, ValueError, TypeError, RecursionError):
        return {}

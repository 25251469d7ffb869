"""A flight from a recording of ROS messages: MCAP, SQLite or ROS 1, file or folder.

Its channels come from the suite's topics, from messages of other projects by their types, from
PX4's topics, or as a mapping says. Ground truth is never read, even where it is recorded.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.channels import ALL_CHANNELS, ROTOR_SPEED
from tombo_bag.columns import ColumnTable, TopicColumns, number_columns, stacked_columns
from tombo_bag.flight import Finding, Flight, Series, damage_findings
from tombo_bag.message_codec import fields_of
from tombo_bag.recording import Recording
from tombo_bag.rotor_topics import RANKS, rotor_reading
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
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_logs.checks.clocks.clock_offsets import DELAY_S
from tombo_logs.readers.csv_log import converted
from tombo_logs.readers.csv_mapping import ATTITUDES, LogMapping
from tombo_logs.readers.ulog import PX4_TOPICS, pose_findings, possible_stamps, px4_series
from tombo_logs.readers.units import factor

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
_PX4 = "px4_msgs"
"""Key of the clock that all topics of PX4 share."""
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
        if _is_truth(source):
            raise InputError(f"{source}:={target}: ground truth is what a diagnosis must not see")
    with Recording(path, names or {}) as recording:
        mapped = set() if mapping is None else {k for g in mapping.by_topic.values() for k in g}
        topics = _topics(recording, skip={MOCAP_POSE.name} if _POSE & mapped else set())
        foreign = _ForeignTopics(recording, name, mapping)
        if MOCAP_POSE.name not in topics and not {*mapped, *foreign.px4} >= _POSE:
            raise _no_pose(recording)
        control = [t for t, kind in _CONTROL.items() if t in _usable_topics(recording, {kind})]
        recording.load([*topics.values(), *control])
        tables = {name: recording.columns(topic) for name, topic in topics.items()}
        asked = {name: recording.columns(name) for name in control}
        typenames = {key: recording.topics[topic].typename for key, topic in topics.items()}
        tables = {key: table for key, table in tables.items() if len(table["log_time_ns"])}
        starts = [s.first_ns for s in recording.topics.values() if s.count]
        metadata = _scenario_name(recording.metadata)
        damage = recording.damage
    used = {key for key, _ in foreign.channels.values()} | ({_PX4} if foreign.px4 else set())
    others = {key: foreign.tables[key] for key in used}
    start_ns = min(starts, default=0)
    clock = _Clock(name, start_ns, {**tables, **others})
    series = {key: clock.shifted(_PX4, channel) for key, channel in foreign.px4.items()}
    for channel, (key, values) in foreign.channels.items():
        series[channel] = clock.series(key, others[key], values)
    for key, table in tables.items():
        for channel, values in _values(key, table, typenames[key]).items():
            if channel not in mapped:
                series[channel] = clock.series(key, table, values)
    said = _Clock(name, start_ns, asked)
    for key, table in asked.items():
        for channel, values in _values(key, table, _CONTROL[key]).items():
            series.setdefault(channel, said.series(key, table, values))
    every = (*damage_findings(name, path, damage), *foreign.findings, *clock.findings)
    return Flight.measured(
        name, f"{path} (recording)", series, findings=every, metadata=metadata, epoch_ns=start_ns
    )


class _ForeignTopics:
    """Topics of a recording that are not the suite's."""

    def __init__(self, recording: Recording, flight: str, mapping: LogMapping | None) -> None:
        """Read the topics that may be of use.

        Raises:
            InputError: a topic or column of the mapping is not there, or is ground truth.
        """
        self.findings: list[Finding] = []
        self.tables: dict[str, ColumnTable] = {}
        """Key of a clock → its table, with `log_time_ns` and `stamp_ns`."""
        self.channels: dict[str, tuple[str, Array]] = {}
        """Channel → key of its table, and values."""
        self.px4: dict[str, Series] = {}
        """Channels from PX4, on its clock [s]."""
        self._recording, self._flight = recording, flight
        self._read_rotors()
        self._read_px4()
        if mapping is not None:
            self._read_mapped(mapping)

    def _table(self, topic: str) -> ColumnTable | None:
        """Return a topic as columns, with stamps; None if its messages can't be read."""
        try:
            table = TopicColumns(topic, self._recording.columns(topic))
        except InputError as error:
            self._say("warning", str(error), topic, "missing")
            return None
        if not len(table["log_time_ns"]):
            return None
        if "stamp_ns" not in table:
            sample, sent = (
                _integer_column(table, name) for name in ("timestamp_sample", "timestamp")
            )
            if sent is None:
                text = f"{topic}: messages have no stamps; times of recording are taken instead"
                self._say("warning", text, topic, "stamps")
                table["stamp_ns"] = table["log_time_ns"]
            else:
                us = sent if sample is None or not sample.any() else sample
                table["stamp_ns"] = us.astype(np.int64) * 1000
        return table

    def _read_rotors(self) -> None:
        by_channel: dict[str, list[tuple[int, str, Array]]] = {}
        for topic, typename in _streams(self._recording).items():
            table = self._table(topic) if typename in RANKS else None
            reading = None if table is None else rotor_reading(typename, topic, table)
            if table is None or reading is None:
                continue
            self.tables[topic] = table
            by_channel.setdefault(reading.channel, []).append(
                (RANKS[typename], topic, reading.values)
            )
            text = f"{reading.channel}: from {topic} ({typename}), as PX4 orders a quad-X"
            remark = f"; {reading.remark}" if reading.remark else ""
            self._say("info", text + remark, reading.channel)
        for channel, readings in by_channel.items():
            best = min(rank for rank, _, _ in readings)
            first = [(topic, values) for rank, topic, values in readings if rank == best]
            if len(first) == 1:
                self.channels[channel] = first[0]
                continue
            topics = " and ".join(topic for topic, _ in first)
            text = f"{channel}: {topics} could be it; left out; accepted: one, named in a mapping"
            self._say("warning", text, channel)

    def _read_px4(self) -> None:
        """Read px4_msgs as a PX4 log's topics are read."""
        topics: dict[str, Mapping[str, NDArray[Any]]] = {}
        late_us: dict[str, float] = {}
        for topic, typename in _streams(self._recording).items():
            name = re.sub(r"_v\d+$", "", topic.rpartition("/")[2])
            if not typename.startswith(f"{_PX4}/") or name not in PX4_TOPICS or name in topics:
                continue
            table = self._table(topic)
            if table is not None:
                topics[name] = dict(number_columns(table))
                late_us[name] = float(np.median(1e-3 * table["log_time_ns"] - table["timestamp"]))
                self.tables.setdefault(_PX4, table)
        topics, findings = possible_stamps(self._flight, topics)
        self.findings += findings
        for name, late in late_us.items():
            self._align(name, topics, late - next(iter(late_us.values())))
        self.px4, source = px4_series(topics, 0.0)
        self.findings += pose_findings(self._flight, source)

    def _align(self, name: str, topics: dict[str, Mapping[str, NDArray[Any]]], us: float) -> None:
        """Put a topic of PX4, or one to it, on the clock of the first, by times of recording."""
        if abs(us) * 1e-6 <= DELAY_S:
            return
        topics[name] = {
            key: np.asarray(column, np.float64) + us if key.startswith("timestamp") else column
            for key, column in topics[name].items()
        }
        text = (
            f"{name}: stamps are {abs(us) * 1e-6:.3g} s {'earlier' if us > 0.0 else 'later'} than "
            "those of the other topics, recorded at the same time: another clock; aligned by the "
            "times of recording"
        )
        self.findings.append(
            Finding("stamps", "warning", self._flight, text, channel=name, key="other clock",
                    numbers=(-us * 1e-6,))
        )  # fmt: skip

    def _read_mapped(self, mapping: LogMapping) -> None:
        for topic, channels in mapping.by_topic.items():
            if _is_truth(topic):
                raise InputError(f"{topic}: ground truth is what a diagnosis must not see")
            table = self._table(topic)
            if topic not in self._recording.topics:
                raise unknown_name(f"topic of '{mapping.name}'", topic, self._recording.topics)
            for key, channel in channels.items():
                if table is None:
                    continue
                values = stacked_columns(table, channel.columns, topic)
                columns = TopicColumns(topic, table)
                if channel.time is not None:
                    unit = factor(channel.time.unit, "s", "time") * 1e9
                    times = stacked_columns(table, [channel.time.column], topic)[:, 0]
                    columns["stamp_ns"] = (times * unit).astype(int)
                self.tables[f"{topic} {key}"] = columns
                self.channels[key] = f"{topic} {key}", converted(key, channel, mapping, values)

    def _say(self, severity: str, text: str, channel: str, check: str = "rpm") -> None:
        self.findings.append(Finding(check, severity, self._flight, text, channel=channel))


def _integer_column(table: ColumnTable, name: str) -> NDArray[Any] | None:
    """Return a column of whole numbers, or None."""
    column = table.get(name)
    whole = column is not None and column.ndim == 1 and column.dtype.kind in "iu"
    return column if whole else None


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
        fitting = [topic for topic in _usable_topics(recording, types) if topic.endswith(key)]
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


def _usable_topics(recording: Recording, types: Collection[str]) -> list[str]:
    """Return the topics of these types that have messages, without ground truth."""
    return [t for t, typename in _streams(recording).items() if typename in types]


def _streams(recording: Recording) -> dict[str, str]:
    """Return topic → type, of topics with messages, without ground truth."""
    topics = recording.topics.items()
    return {t: s.typename for t, s in topics if s.count and not _is_truth(t)}


def _is_truth(topic: str) -> bool:
    return "ground_truth" in topic.split("/")


def _no_pose(recording: Recording) -> InputError:
    poses = _usable_topics(recording, POSE_TYPES)
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

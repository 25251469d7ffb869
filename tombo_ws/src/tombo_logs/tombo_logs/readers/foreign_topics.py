"""Channels of a recording in other projects' messages: by type, from PX4, or as a mapping says."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable, TopicColumns, number_columns, stacked_columns
from tombo_bag.flight import Finding, Series
from tombo_bag.recording import Recording
from tombo_bag.rotor_topics import RANKS, is_rotor_type, rotor_reading
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_logs.checks.clocks.clock_offsets import DELAY_S
from tombo_logs.readers.csv_log import converted
from tombo_logs.readers.csv_mapping import LogMapping
from tombo_logs.readers.ulog import PX4_TOPICS, pose_findings, possible_stamps, px4_series
from tombo_logs.readers.units import factor

PX4 = "px4_msgs"
"""Key of the clock that all topics of PX4 share."""
_TRUTH = "ground_truth"


class ForeignTopics:
    """Topics of a recording that are not the suite's."""

    def __init__(self, recording: Recording, flight: str, mapping: LogMapping | None) -> None:
        """Read the topics that may be of use.

        Raises:
            InputError: a topic or column of the mapping is not there, or is ground truth.
        """
        self.findings: list[Finding] = []
        self.tables: dict[str, ColumnTable] = {}
        """By key of a clock, each with `log_time_ns` and `stamp_ns`."""
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

    def _streams(self) -> list[tuple[str, str]]:
        """Return (topic, type) of topics with messages, in order."""
        topics = self._recording.topics.items()
        return [(t, s.typename) for t, s in topics if s.count and _TRUTH not in t.split("/")]

    def _read_rotors(self) -> None:
        by_channel: dict[str, list[tuple[int, str, Array]]] = {}
        for topic, typename in self._streams():
            table = self._table(topic) if is_rotor_type(typename) else None
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
        for topic, typename in self._streams():
            name = re.sub(r"_v\d+$", "", topic.rpartition("/")[2])
            if not typename.startswith(f"{PX4}/") or name not in PX4_TOPICS or name in topics:
                continue
            table = self._table(topic)
            if table is not None:
                topics[name] = dict(number_columns(table))
                late_us[name] = float(np.median(1e-3 * table["log_time_ns"] - table["timestamp"]))
                self.tables.setdefault(PX4, table)
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
            if _TRUTH in topic.split("/"):
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

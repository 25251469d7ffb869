"""One flight, flown or measured: the messages of its topics, as columns over time.

The simulation writes it, recordings and logs of other projects are read into it; figures,
pictures, files and the diagnosis are made from it. World `map` is ENU, body `base_link` FLU; SI
units, rad, quaternions xyzw.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.channels import ALL_CHANNELS, CHANNELS, CONTROL_CHANNELS, ROTOR_SPEEDS
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name

_NAMES = {(channel.topic, channel.field): name for name, channel in CHANNELS.items()}
"""Topic and field → name of the channel."""


@dataclass(frozen=True)
class Series:
    """One field of the messages of a topic. Values that are not finite are gaps."""

    t: Array
    """(N,) capture times [s] on the flight's own clock, as stamped."""
    values: NDArray[Any]
    """(N,) or (N, width), unit and frame as in the definition of the message."""
    arrival: Array | None = None
    """(N,) when each sample came in [s], same clock; None where nothing says it."""

    def at(self, rows: NDArray[Any] | slice) -> Series:
        """Return these rows of it: a mask (N,), indices or a slice."""
        arrival = None if self.arrival is None else self.arrival[rows]
        return Series(self.t[rows], self.values[rows], arrival)


class Topic(dict[str, Series]):
    """The messages of one topic: field of the message → series.

    Names are those of the message in `tombo_dynamics.messages`, else in its definition. The
    fields share their times, unless a log has stamps of its own for some.
    """

    @property
    def t(self) -> Array:
        """(N,) capture times of the first field [s]."""
        return next(iter(self.values())).t

    @property
    def arrival(self) -> Array:
        """(N,) when each message was there [s]; the times of capture where nothing says it."""
        first = next(iter(self.values()))
        return first.t if first.arrival is None else first.arrival

    @staticmethod
    def of(t: Array, columns: Mapping[str, NDArray[Any]], arrival: Array | None = None) -> Topic:
        """Return the messages with these times and fields: views of them."""
        return Topic({name: Series(t, values, arrival) for name, values in columns.items()})

    def __missing__(self, name: str) -> Series:
        """Raise the error that names the field and the existing fields."""
        raise unknown_name("field of the topic", name, self)


@dataclass(frozen=True)
class Finding:
    """Finding of a pre-check or a reader. A fault of the log is never diagnosed as physics."""

    check: str
    """Short name: crash, gap, frozen, duplicate, frame, unit, stamps, saturation, rpm, missing."""
    severity: str
    """info, warning (diagnosed all the same) or fault (the part it concerns is excluded)."""
    flight: str
    message: str
    """One line: channel, observation, expectation."""
    start_s: float = float("nan")
    """On the flight's clock; NaN: it concerns the whole flight."""
    end_s: float = float("nan")
    channel: str = ""
    key: str = ""
    """The mistake, where the check distinguishes several; else empty."""
    subject: str = ""
    """The rotor or the axis that it is about, or where the channel was read from."""
    numbers: tuple[float, ...] = ()
    """Measured values, in the order and the units of the message."""


def finding_mapping(finding: Finding) -> dict[str, Any]:
    """Return a finding as plain values; null: it concerns the whole flight."""
    times = (finding.start_s, finding.end_s)
    begin, end = (None if x != x else x for x in times)
    return {
        "check": finding.check, "key": finding.key, "severity": finding.severity,
        "channel": finding.channel, "subject": finding.subject, "numbers": list(finding.numbers),
        "start_s": begin, "end_s": end, "message": finding.message,
    }  # fmt: skip


class RefusedLog(InputError):
    """A flight that can't be used, with the finding that says why."""

    def __init__(self, flight: str, channel: str, text: str, key: str = "") -> None:
        super().__init__(f"flight '{flight}': {text}")
        self.finding = Finding("refused", "fault", flight, text, channel=channel, key=key)


def why_left_out(findings: Iterable[Finding], channels: Iterable[str]) -> str:
    """Return in brackets what checks had against channels that are not there; else nothing."""
    names = set(channels)
    faults = [f for f in findings if f.channel in names and f.severity == "fault"]
    why = "; ".join(f.message for f in faults)
    return f" ({why})" if why else ""


def damage_findings(flight: str, path: Path, damage: Iterable[str]) -> list[Finding]:
    """Report what of a file could not be read."""
    return [Finding("damage", "warning", flight, f"{path.name}: {text}") for text in damage]


@dataclass(frozen=True)
class Airframe:
    """Known parameters of the vehicle that flew. None: the suite's own nominal vehicle."""

    name: str
    mass: float
    """[kg]"""
    arm_length: float
    """centre to rotor axis [m]"""
    rotor_radius: float
    """[m]"""
    inertia: tuple[float, float, float] | None = None
    """about body x, y, z [kg m^2]; None: not known, moments are then not diagnosed."""
    motor_time_constant: float = 0.05
    """[s]"""


@dataclass(frozen=True)
class Flight:
    """A flight; unknown parts are empty."""

    topics: Mapping[str, Topic]
    """By name, as `/mocap/pose`. Of a simulated flight what the cores said and its sensors."""
    name: str = ""
    """Short and unique among the flights of one diagnosis."""
    source: str = ""
    """File that it was read from, and its kind; empty: it was flown here."""
    t: Array = field(default_factory=lambda: np.zeros(0))
    """(N,) time of each tick [s], from 0 in steps of 1 ms."""
    log: Mapping[str, Array] = field(default_factory=dict)
    """Truth and the autopilot's set points, tick by tick: the columns (N, k) of
    `tombo_sim.kernel`."""
    events: list[dict[str, Any]] = field(default_factory=list)
    """What happened: time_s, kind, text and more, in order of time."""
    scenario: dict[str, Any] = field(default_factory=dict)
    """The scenario as flown, including what the seed drew."""
    summary: dict[str, Any] = field(default_factory=dict)
    """The figures of `summary.json`."""
    findings: tuple[Finding, ...] = ()
    """Findings of the reader."""
    epoch_ns: int = 0
    """Stamp at t = 0."""
    airframe: Airframe | None = None
    """Airframe of a measured flight."""
    exclude: tuple[tuple[float, float], ...] = ()
    """Spans [s] that are not diagnosed: crash, contact, on the ground."""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """What its source says besides."""

    @staticmethod
    def measured(name: str, source: str, series: Mapping[str, Series], **more: Any) -> Flight:
        """Return a flight of these channels, by their names in `CHANNELS`; `more` goes to it."""
        return Flight({}, name, source, **more).with_series(series)

    @property
    def series(self) -> dict[str, Series]:
        """The channels that it has, by their names in `CHANNELS`, in the order of its topics."""
        return {
            _NAMES[topic, name]: series
            for topic, fields in self.topics.items()
            for name, series in fields.items()
            if (topic, name) in _NAMES
        }

    def with_series(self, series: Mapping[str, Series]) -> Flight:
        """Return the flight with these channels, by their names in `CHANNELS`, and no others.

        Those in `CONTROL_CHANNELS` stay as they are, unless they are given.
        """
        topics: dict[str, Topic] = {}
        series = {**self.control, **series}
        for name, channel in series.items():
            topics.setdefault(ALL_CHANNELS[name].topic, Topic())[ALL_CHANNELS[name].field] = (
                channel
            )
        return replace(self, topics=topics)

    @property
    def control(self) -> dict[str, Series]:
        """What its controller estimated and asked for, by the names in `CONTROL_CHANNELS`."""
        return {
            name: self.topics[channel.topic][channel.field]
            for name, channel in CONTROL_CHANNELS.items()
            if channel.topic in self.topics and channel.field in self.topics[channel.topic]
        }

    @property
    def has_rotor_speeds(self) -> bool:
        """Whether speeds of the rotors are known, measured or asked for."""
        return any(name in self.series for name in ROTOR_SPEEDS)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last stamp of any channel [s]."""
        ends = [(s.t[0], s.t[-1]) for s in self.series.values() if s.t.size]
        return max(e for _, e in ends) - min(b for b, _ in ends) if ends else 0.0

    def __getitem__(self, topic: str) -> Topic:
        """Return a topic.

        Raises:
            InputError: there is none of this name.
        """
        if topic not in self.topics:
            raise unknown_name("topic", topic, self.topics)
        return self.topics[topic]

    def seconds(self, stamps_ns: NDArray[np.int64]) -> Array:
        """Return stamps as times of the flight [s]."""
        return np.asarray((np.asarray(stamps_ns, np.int64) - self.epoch_ns) * 1e-9)

"""The clock of the recorded nodes, where it differs from the recorder's.

A recorder stamps messages by its machine's clock, also when the suite flies in simulated time or
on another machine. What the nodes took for now is then given by their own stamps.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np

from tombo_bag.formats.bag_files import RawMessages, Stream
from tombo_bag.recording import Recording
from tombo_bag.topics import IMU, MISSION_SETPOINT, ODOMETRY, SETPOINT
from tombo_dynamics.arrays import Times
from tombo_dynamics.time_base import SECOND_NS

CLOCK_TOPICS = (MISSION_SETPOINT.name, SETPOINT.name)
"""Topics whose stamps are the nodes' now."""
_STAMP = struct.Struct("<iI")
_SHORTEST = 12
_SOME = 100
_APART_NS = 250_000_000
"""Nearer clocks are one clock."""


def find_suite_clock(recording: Recording) -> tuple[Times, Times] | None:
    """Return log times, rising, and the nodes' time at each; None if it is the recorder's.

    A node's set points are stamped when they are said. Now is then the newest stamp that has
    been recorded, of set points and of whatever else is stamped by the same clock.
    """
    topics = recording.topics
    there = [name for name in (*CLOCK_TOPICS, ODOMETRY.name, IMU.name) if _count(topics, name)]
    if not there or there[0] not in CLOCK_TOPICS:
        return None
    if abs(_clock_offset_ns(recording.messages(there[0]))) < _APART_NS:
        return None
    recording.load(there)
    pairs: list[tuple[Times, Times]] = []
    for topic in there:
        table = recording.columns(topic)
        if "stamp_ns" not in table or not len(table["stamp_ns"]):
            continue
        log, stamp = table["log_time_ns"], table["stamp_ns"]
        reported = np.interp(log, *pairs[0]) if pairs else stamp
        if abs(float(np.median(stamp - reported))) < _APART_NS:
            pairs.append((log, stamp))
    if not pairs:
        return None
    log, stamp = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    order = np.argsort(log, kind="stable")
    return log[order], np.maximum.accumulate(stamp[order])


def _count(topics: Mapping[str, Stream], name: str) -> int:
    return topics[name].count if name in topics else 0


def _clock_offset_ns(raw: RawMessages) -> float:
    """Return how far some stamps are ahead of log times; a header's stamp stands in front."""
    some = slice(0, None, len(raw.messages) // _SOME + 1)
    ahead = [
        seconds * SECOND_NS + rest - log
        for (seconds, rest), log in zip(
            (_STAMP.unpack_from(m, 4) for m in raw.messages[some] if len(m) >= _SHORTEST),
            raw.log_times_ns[some].tolist(),
            strict=False,
        )
    ]
    return float(np.median(ahead)) if ahead else 0.0

"""The clock that the recorded nodes lived by, when the recorder's was another.

A recorder stamps messages by its machine's clock, also when the suite flies in simulated time or
on another machine. What the nodes took for now is then told by their own stamps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_bag.recording import Recording
from tombo_bag.topics import IMU, MISSION_SETPOINT, ODOMETRY, SETPOINT

Times = NDArray[np.int64]

_APART_NS = 250_000_000
"""Nearer clocks are one clock."""


def find_suite_clock(recording: Recording) -> tuple[Times, Times] | None:
    """Return log times, rising, and the nodes' time at each; None if it is the recorder's.

    A node's set points are stamped when they are said. Now is then the newest stamp that has
    been recorded, of set points and of whatever else is stamped by the same clock.
    """
    pairs: list[tuple[Times, Times]] = []
    lead: float | None = None
    for topic in (MISSION_SETPOINT.name, SETPOINT.name, ODOMETRY.name, IMU.name):
        if topic not in recording.topics or not recording.topics[topic].count:
            continue
        table = recording.columns(topic)
        if "stamp_ns" not in table or not len(table["stamp_ns"]):
            continue
        ahead = float(np.median(table["stamp_ns"] - table["log_time_ns"]))
        if lead is None:
            if topic not in (MISSION_SETPOINT.name, SETPOINT.name):
                return None
            lead = ahead
        if abs(ahead - lead) < _APART_NS:
            pairs.append((table["log_time_ns"], table["stamp_ns"]))
    if lead is None or abs(lead) < _APART_NS:
        return None
    log, stamp = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    order = np.argsort(log, kind="stable")
    return log[order], np.maximum.accumulate(stamp[order])

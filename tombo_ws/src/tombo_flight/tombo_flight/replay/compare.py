"""Compares the recorded outputs with the replayed ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_flight.replay.merge_streams import last_before
from tombo_flight.replay.outputs import Event, Series

STEP_NS = 25_000_000
"""A set point may change this much earlier or later: a period of the mission, and a bit."""
MATCH_NS = 500_000_000
"""Events further apart than this are two events."""


@dataclass(frozen=True)
class Tolerances:
    """Largest differences that `--strict` accepts."""

    time_ms: float = 0.0
    """Capture time of the pose that triggered."""
    x_c_m: float = 1e-3
    statistic: float = 0.1
    setpoint_m: float = 0.01
    odometry_m: float = 5e-3
    command_rad_s: float = 5.0


def pairs(
    recorded: Sequence[Event], replayed: Sequence[Event]
) -> tuple[list[tuple[Event, Event]], list[Event], list[Event]]:
    """Match events by the nearest stamp; return the pairs, those missed, those extra."""
    distances = sorted(
        (abs(a.stamp_ns - b.stamp_ns), i, j)
        for i, a in enumerate(recorded)
        for j, b in enumerate(replayed)
        if abs(a.stamp_ns - b.stamp_ns) <= MATCH_NS
    )
    taken: dict[int, int] = {}
    used: set[int] = set()
    for _, i, j in distances:
        if i not in taken and j not in used:
            taken[i] = j
            used.add(j)
    matched = [(recorded[i], replayed[j]) for i, j in sorted(taken.items())]
    missed = [event for i, event in enumerate(recorded) if i not in taken]
    extra = [event for j, event in enumerate(replayed) if j not in used]
    return matched, missed, extra


def compare_events(
    recorded: Sequence[Event], replayed: Sequence[Event], begin_ns: int
) -> dict[str, Any]:
    """Return the figures of two lists of events; times in seconds after `begin_ns`."""
    matched, missed, extra = pairs(recorded, replayed)
    return {
        "events_recorded": [event_metrics(event, begin_ns) for event in recorded],
        "events_replayed": [event_metrics(event, begin_ns) for event in replayed],
        "matched": len(matched),
        "missed": len(missed),
        "extra": len(extra),
        "detection_time_difference_ms": [(b.stamp_ns - a.stamp_ns) / 1e6 for a, b in matched],
        "known_time_difference_ms": [(b.known_ns - a.known_ns) / 1e6 for a, b in matched],
        "x_c_error_m": [math.dist(a.x_c, b.x_c) for a, b in matched],
    }


def event_metrics(event: Event, begin_ns: int) -> dict[str, Any]:
    """Return an event as plain values."""
    return {
        "stamp_s": (event.stamp_ns - begin_ns) / 1e9,
        "known_s": (event.known_ns - begin_ns) / 1e9,
        "trigger": event.trigger,
        "x_c_m": list(event.x_c),
        "flight_direction": list(event.flight_direction),
        "statistic": event.statistic,
        "confidence": event.confidence,
    }


def aligned(recorded: Series, replayed: Series) -> tuple[Array, Array, Array]:
    """Return rows of both series with the nearest stamps, and how far these are apart [s].

    A recorded sample without a replayed one within 0.6 of the usual step has no partner.
    """
    width = recorded.values.shape[1]
    if len(recorded.stamp_ns) == 0 or len(replayed.stamp_ns) == 0:
        return np.zeros((0, width)), np.zeros((0, width)), np.zeros(0)
    order = np.argsort(replayed.stamp_ns, kind="stable")
    stamps, values = replayed.stamp_ns[order], replayed.values[order]
    right = np.clip(np.searchsorted(stamps, recorded.stamp_ns), 0, len(stamps) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.abs(stamps[left] - recorded.stamp_ns) < np.abs(stamps[right] - recorded.stamp_ns)
    partner = np.where(nearer, left, right)
    apart = (stamps[partner] - recorded.stamp_ns) / 1e9
    steps = np.diff(np.sort(recorded.stamp_ns)) / 1e9
    usual = float(np.median(steps)) if len(steps) else 0.0
    near = np.abs(apart) <= max(0.6 * usual, 1e-6)
    return recorded.values[near], values[partner][near], apart[near]


def compare_series(recorded: Series, replayed: Series, unit: str) -> dict[str, Any]:
    """Return RMS and largest difference (length of the difference of rows)."""
    a, b, _ = aligned(recorded, replayed)
    return {
        "recorded": len(recorded.stamp_ns),
        "replayed": len(replayed.stamp_ns),
        "compared": len(a),
        **_size(np.linalg.norm(b - a, axis=1), unit),
    }


def compare_steps(recorded: Series, replayed: Series, unit: str) -> dict[str, Any]:
    """Compare what holds until the next message: as `compare_series`, but a step may come early.

    Or late, by up to `STEP_NS`: that much lies between two clocks' readings of one moment.
    """
    order = np.argsort(replayed.stamp_ns, kind="stable")
    stamps, values = replayed.stamp_ns[order], replayed.values[order]
    sizes: Array = np.full((3, len(recorded.stamp_ns)), np.nan)
    for size, shift in zip(sizes, (0, -STEP_NS, STEP_NS), strict=True):
        row = last_before(stamps, recorded.stamp_ns + shift)
        there = row >= 0
        size[there] = np.linalg.norm(values[row[there]] - recorded.values[there], axis=1)
    known = ~np.isnan(sizes[0])
    return {
        "recorded": len(recorded.stamp_ns),
        "replayed": len(replayed.stamp_ns),
        "compared": int(known.sum()),
        **_size(np.fmin.reduce(sizes[:, known], axis=0), unit),
    }


def compare_attitudes(recorded: Series, replayed: Series) -> dict[str, Any]:
    """Return RMS and largest angle between quaternions [rad]."""
    a, b, _ = aligned(recorded, replayed)
    cosine = np.abs(np.sum(a * b, axis=1))
    return {"compared": len(a), **_size(2.0 * np.arccos(np.minimum(cosine, 1.0)), "rad")}


def _size(size: Array, unit: str) -> dict[str, Any]:
    good = size[np.isfinite(size)]
    if not len(good):
        return {f"rms_{unit}": None, f"max_{unit}": None}
    return {f"rms_{unit}": float(np.sqrt(np.mean(good**2))), f"max_{unit}": float(np.max(good))}

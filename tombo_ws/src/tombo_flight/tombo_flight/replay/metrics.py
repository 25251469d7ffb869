"""Figures of each node, recorded and replayed, and how far the two differ."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import PHASE_NAMES
from tombo_flight.replay.outputs import DetectedEvent, Outputs, OutputSeries

STEP_NS: Final = 25_000_000
"""A set point may change this much earlier or later: a period of the mission, and a bit."""
MATCH_NS: Final = 500_000_000
"""Events further apart than this are two events."""
_X_C_M: Final = 1e-3
"""Difference of the estimated place of a collision that is none [m]."""
Metrics = dict[str, Any]


def pairs(
    recorded: Sequence[DetectedEvent], replayed: Sequence[DetectedEvent]
) -> tuple[list[tuple[DetectedEvent, DetectedEvent]], list[DetectedEvent], list[DetectedEvent]]:
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
    recorded: Sequence[DetectedEvent], replayed: Sequence[DetectedEvent]
) -> Metrics:
    """Return the figures of two lists of events."""
    matched, missed, extra = pairs(recorded, replayed)
    places = [(a.message.contact_position, b.message.contact_position) for a, b in matched]
    return {
        "matched": len(matched),
        "missed": len(missed),
        "extra": len(extra),
        "detection_time_difference_ms": [(b.stamp_ns - a.stamp_ns) / 1e6 for a, b in matched],
        "known_time_difference_ms": [(b.known_ns - a.known_ns) / 1e6 for a, b in matched],
        "x_c_error_m": [math.dist(a, b) for a, b in places],
    }


def event_metrics(event: DetectedEvent, begin_ns: int) -> Metrics:
    """Return an event as plain values; times in seconds after `begin_ns`."""
    message = event.message
    return {
        "stamp_s": (event.stamp_ns - begin_ns) / 1e9,
        "known_s": (event.known_ns - begin_ns) / 1e9,
        "trigger": event.trigger,
        "x_c_m": message.contact_position.tolist(),
        "flight_direction": message.flight_direction.tolist(),
        "statistic": message.statistic,
        "confidence": message.confidence,
    }


def aligned(recorded: OutputSeries, replayed: OutputSeries) -> tuple[Array, Array]:
    """Return the rows of both series with the nearest stamps.

    A recorded sample without a replayed one within 0.6 of the usual step has no partner.
    """
    width = recorded.values.shape[1]
    if len(recorded.stamp_ns) == 0 or len(replayed.stamp_ns) == 0:
        return np.zeros((0, width)), np.zeros((0, width))
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
    return recorded.values[near], values[partner][near]


def _differences(recorded: OutputSeries, replayed: OutputSeries) -> Array:
    """Return the lengths of the differences of samples of one time."""
    a, b = aligned(recorded, replayed)
    return np.asarray(np.linalg.norm(b - a, axis=1))


def _angles(recorded: OutputSeries, replayed: OutputSeries) -> Array:
    """Return the angles between quaternions of one time [rad]."""
    a, b = aligned(recorded, replayed)
    cosine = np.abs(np.sum(a * b, axis=1))
    return np.asarray(2.0 * np.arccos(np.minimum(cosine, 1.0)))


def _step_differences(recorded: OutputSeries, replayed: OutputSeries) -> Array:
    """Return differences of what holds until the next message.

    A step may come `STEP_NS` earlier or later: that much lies between two clocks' readings of one
    moment.
    """
    order = np.argsort(replayed.stamp_ns, kind="stable")
    stamps, values = replayed.stamp_ns[order], replayed.values[order]
    sizes: Array = np.full((3, len(recorded.stamp_ns)), np.nan)
    for size, shift in zip(sizes, (0, -STEP_NS, STEP_NS), strict=True):
        row = np.searchsorted(stamps, recorded.stamp_ns + shift, side="right") - 1
        there = row >= 0
        size[there] = np.linalg.norm(values[row[there]] - recorded.values[there], axis=1)
    return np.asarray(np.fmin.reduce(sizes[:, ~np.isnan(sizes[0])], axis=0))


@dataclass(frozen=True)
class Compared:
    """A series of a node, and how it is compared."""

    key: str
    """Of the figures."""
    name: str
    """On a page."""
    series: str
    """One of `outputs.SERIES`."""
    unit: str
    tolerance: float = math.inf
    """Largest RMS difference that is none."""
    difference: Callable[[OutputSeries, OutputSeries], Array] = _differences

    def metrics(self, recorded: Outputs, replayed: Outputs) -> tuple[Metrics | None, list[str]]:
        """Return RMS and largest difference, None: not recorded; and what is beyond tolerance."""
        if self.series not in recorded.series:
            return None, []
        series = recorded.series[self.series], replayed.series[self.series]
        differences = self.difference(*series)
        finite = differences[np.isfinite(differences)]
        rms = float(np.sqrt(np.mean(finite**2))) if finite.size else None
        metrics = {
            "recorded": len(series[0].stamp_ns),
            "replayed": len(series[1].stamp_ns),
            "compared": len(differences),
            f"rms_{self.unit}": rms,
            f"max_{self.unit}": float(finite.max()) if finite.size else None,
        }
        if metrics["recorded"] and not metrics["compared"]:
            return metrics, [f"no {self.name} to compare with {metrics['recorded']} recorded ones"]
        if rms is None or rms <= self.tolerance:
            return metrics, []
        return metrics, [f"{self.name} differs by {rms:.3g} {unit_text(self.unit)} RMS"]


def unit_text(key: str) -> str:
    """Return the unit that ends a key of figures, as it is written."""
    return {"statistic": "", "m_s": "m/s", "rad_s": "rad/s"}.get(key, key)


COMPARED: Final[dict[str, tuple[Compared, ...]]] = {
    "detector": (Compared("statistic", "statistic", "statistic", "statistic", 0.1),),
    "mission": (
        Compared("setpoint", "set point", "mission_setpoint", "m", 0.01, _step_differences),
    ),
    "reaction": (Compared("setpoint", "set point", "setpoint", "m", 0.01, _step_differences),),
    "estimator": (
        Compared("position", "position", "odometry_position", "m", 5e-3),
        Compared("velocity", "velocity", "odometry_velocity", "m_s"),
        Compared("attitude", "attitude", "odometry_attitude", "rad", difference=_angles),
    ),
    "controller": (Compared("rotor_command", "rotor command", "rotor_command", "rad_s", 5.0),),
}
"""Node → its series."""


@dataclass(frozen=True)
class Context:
    """Common data of the figures."""

    begin_ns: int
    contacts_ns: list[int] | None
    """True contacts; None: the truth is not known."""


def metrics_of(
    node: str, recorded: Outputs, replayed: Outputs, context: Context
) -> tuple[Metrics, list[str]]:
    """Return a node's figures, and a line for each figure beyond its tolerance."""
    more = _MORE.get(node)
    metrics, differing = ({}, []) if more is None else more(recorded, replayed, context)
    for compared in COMPARED.get(node, ()):
        metrics[compared.key], lines = compared.metrics(recorded, replayed)
        differing += lines
    return metrics, differing


def _detector(recorded: Outputs, replayed: Outputs, context: Context) -> tuple[Metrics, list[str]]:
    begin_ns, contacts = context.begin_ns, context.contacts_ns
    events = replayed.events or []
    metrics: Metrics = {"events_recorded": None}
    differing: list[str] = []
    if recorded.events is not None:
        metrics = {"events_recorded": [event_metrics(e, begin_ns) for e in recorded.events]}
        metrics |= compare_events(recorded.events, events)
        differing = _event_differences(metrics)
    metrics["events_replayed"] = [event_metrics(event, begin_ns) for event in events]
    metrics["false_alarms"] = None if contacts is None else _false_alarms(events, contacts)
    metrics["latency_ms"] = _latencies_ms(events, contacts)
    return metrics, differing


def _event_differences(metrics: Metrics) -> list[str]:
    differing = []
    for what in ("missed", "extra"):
        if metrics[what]:
            differing.append(f"{metrics[what]} event{'s' * (metrics[what] > 1)} {what}")
    late = max(map(abs, metrics["detection_time_difference_ms"]), default=0.0)
    if late > 0.0:
        differing.append(f"detection differs by {late:.3f} ms")
    off = max(metrics["x_c_error_m"], default=0.0)
    if not off <= _X_C_M:
        differing.append(f"x_c differs by {1e3 * off:.3f} mm")
    return differing


def _mission(recorded: Outputs, replayed: Outputs, context: Context) -> tuple[Metrics, list[str]]:
    bounds = (0, len(PHASE_NAMES) - 1)
    before, after = (_changes(outputs, "phase", bounds) for outputs in (recorded, replayed))
    names = [[PHASE_NAMES[int(phase)] for _, (phase,) in phases] for phases in (before, after)]
    same = names[0] == names[1]
    metrics: Metrics = {
        "phases_recorded": names[0],
        "phases_replayed": names[1],
        "phase_time_difference_ms": [
            (b - a) / 1e6 for (a, _), (b, _) in zip(before, after, strict=True)
        ]
        if same
        else None,
    }
    if same or not before:
        return metrics, []
    return metrics, [f"phases {', '.join(names[1])} instead of {', '.join(names[0])}"]


def _reaction(recorded: Outputs, replayed: Outputs, context: Context) -> tuple[Metrics, list[str]]:
    before, after = (_changes(outputs, "x_r") for outputs in (recorded, replayed))
    both = list(zip(before, after, strict=False))
    metrics: Metrics = {
        "switches_recorded": len(before),
        "switches_replayed": len(after),
        "switch_time_difference_ms": [(b - a) / 1e6 for (a, _), (b, _) in both],
        "x_r_error_m": [math.dist(a, b) for (_, a), (_, b) in both],
    }
    if "x_r" not in recorded.series or len(before) == len(after):
        return metrics, []
    return metrics, [f"{len(after)} switches to an x_r instead of {len(before)}"]


_MORE: Final = {"detector": _detector, "mission": _mission, "reaction": _reaction}
"""Node → further figures."""


def _changes(
    outputs: Outputs, name: str, bounds: tuple[float, float] = (-math.inf, math.inf)
) -> list[tuple[int, list[float]]]:
    """Return stamp and value, held within bounds, of each finite value that was new."""
    series = outputs.series.get(name)
    changes: list[tuple[int, list[float]]] = []
    if series is None:
        return changes
    values = np.clip(series.values, *bounds).tolist()
    for stamp, value in zip(series.stamp_ns.tolist(), values, strict=True):
        if all(map(math.isfinite, value)) and (not changes or changes[-1][1] != value):
            changes.append((stamp, value))
    return changes


def _false_alarms(events: Sequence[DetectedEvent], contacts_ns: Sequence[int]) -> int:
    """Count innovation events before the first true contact; a region may rightly be early."""
    first = min(contacts_ns, default=None)
    return sum(
        first is None or (event.trigger != "region" and event.stamp_ns < first) for event in events
    )


def _latencies_ms(
    events: Sequence[DetectedEvent], contacts_ns: list[int] | None
) -> list[float | None]:
    """Return for each event the time from the newest true contact before it until it was known."""
    latencies: list[float | None] = []
    for event in events:
        before = [contact for contact in contacts_ns or [] if contact <= event.stamp_ns]
        latencies.append((event.known_ns - max(before)) / 1e6 if before else None)
    return latencies

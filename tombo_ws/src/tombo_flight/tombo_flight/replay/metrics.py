"""Figures of each node, recorded and replayed, and how far the two differ."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import PHASE_NAMES
from tombo_dynamics.params import param
from tombo_flight.replay.outputs import DetectedEvent, Outputs, OutputSeries

STEP_NS = 25_000_000
"""A set point may change this much earlier or later: a period of the mission, and a bit."""
MATCH_NS = 500_000_000
"""Events further apart than this are two events."""
_ANY = (0.0, 1e12)


@dataclass(frozen=True)
class Tolerances:
    """Largest differences that `--strict` accepts."""

    time_ms: float = param(0.0, "ms", _ANY, "capture time of the pose that triggered")
    x_c_m: float = param(1e-3, "m", _ANY, "estimated place of the collision")
    statistic: float = param(0.1, "1", _ANY, "of the detector, RMS")
    setpoint_m: float = param(0.01, "m", _ANY, "set points, RMS")
    odometry_m: float = param(5e-3, "m", _ANY, "estimated position, RMS")
    command_rad_s: float = param(5.0, "rad/s", _ANY, "commands of rotors, RMS")


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
    recorded: Sequence[DetectedEvent], replayed: Sequence[DetectedEvent], begin_ns: int
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


def event_metrics(event: DetectedEvent, begin_ns: int) -> dict[str, Any]:
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


def aligned(recorded: OutputSeries, replayed: OutputSeries) -> tuple[Array, Array, Array]:
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


def compare_series(recorded: OutputSeries, replayed: OutputSeries, unit: str) -> dict[str, Any]:
    """Return RMS and largest difference (length of the difference of rows)."""
    a, b, _ = aligned(recorded, replayed)
    return {
        "recorded": len(recorded.stamp_ns),
        "replayed": len(replayed.stamp_ns),
        "compared": len(a),
        **_size(np.linalg.norm(b - a, axis=1), unit),
    }


def compare_steps(recorded: OutputSeries, replayed: OutputSeries, unit: str) -> dict[str, Any]:
    """Compare what holds until the next message: as `compare_series`, but a step may come early.

    Or late, by up to `STEP_NS`: that much lies between two clocks' readings of one moment.
    """
    order = np.argsort(replayed.stamp_ns, kind="stable")
    stamps, values = replayed.stamp_ns[order], replayed.values[order]
    sizes: Array = np.full((3, len(recorded.stamp_ns)), np.nan)
    for size, shift in zip(sizes, (0, -STEP_NS, STEP_NS), strict=True):
        row = np.searchsorted(stamps, recorded.stamp_ns + shift, side="right") - 1
        there = row >= 0
        size[there] = np.linalg.norm(values[row[there]] - recorded.values[there], axis=1)
    known = ~np.isnan(sizes[0])
    return {
        "recorded": len(recorded.stamp_ns),
        "replayed": len(replayed.stamp_ns),
        "compared": int(known.sum()),
        **_size(np.fmin.reduce(sizes[:, known], axis=0), unit),
    }


def compare_attitudes(recorded: OutputSeries, replayed: OutputSeries) -> dict[str, Any]:
    """Return RMS and largest angle between quaternions [rad]."""
    a, b, _ = aligned(recorded, replayed)
    cosine = np.abs(np.sum(a * b, axis=1))
    return {"compared": len(a), **_size(2.0 * np.arccos(np.minimum(cosine, 1.0)), "rad")}


def _size(size: Array, unit: str) -> dict[str, Any]:
    good = size[np.isfinite(size)]
    if not len(good):
        return {f"rms_{unit}": None, f"max_{unit}": None}
    return {f"rms_{unit}": float(np.sqrt(np.mean(good**2))), f"max_{unit}": float(np.max(good))}


Metrics = dict[str, Any]


@dataclass(frozen=True)
class Context:
    """Common data of the figures."""

    begin_ns: int
    minutes: float
    """Length of the track of poses."""
    contacts_ns: list[int] | None
    """True contacts; None: the truth is not known."""
    tolerances: Tolerances


def metrics_of(
    node: str, recorded: Outputs, replayed: Outputs, context: Context
) -> tuple[Metrics, list[str]]:
    """Return a node's figures, and what is beyond the tolerances, a line each."""
    return _METRICS[node](recorded, replayed, context)


def _detector(recorded: Outputs, replayed: Outputs, context: Context) -> tuple[Metrics, list[str]]:
    events = replayed.events or []
    metrics: Metrics = {
        "events_recorded": None,
        "events_replayed": [event_metrics(event, context.begin_ns) for event in events],
    }
    found: list[str] = []
    if recorded.events is not None:
        metrics = compare_events(recorded.events, events, context.begin_ns)
        found = _event_differences(metrics, context.tolerances)
        metrics["extra_per_minute"] = _per_minute(metrics["extra"], context)
    contacts = context.contacts_ns
    alarms = None if contacts is None else _false_alarms(events, contacts)
    metrics["false_alarms"] = alarms
    metrics["false_alarms_recorded"] = (
        None
        if contacts is None or recorded.events is None
        else _false_alarms(recorded.events, contacts)
    )
    metrics["false_alarms_per_minute"] = None if alarms is None else _per_minute(alarms, context)
    metrics["latency_ms"] = _latencies_ms(events, contacts)
    metrics["latency_recorded_ms"] = _latencies_ms(recorded.events or [], contacts)
    if "statistic" in recorded.series:
        statistic = compare_series(
            recorded.series["statistic"], replayed.series["statistic"], "statistic"
        )
        metrics["statistic"] = statistic
        found += _over(statistic, "statistic", context.tolerances.statistic, "statistic")
    return metrics, found


def _event_differences(metrics: Metrics, tolerances: Tolerances) -> list[str]:
    found = []
    for what in ("missed", "extra"):
        if metrics[what]:
            found.append(f"{metrics[what]} event{'s' * (metrics[what] > 1)} {what}")
    late = max(map(abs, metrics["detection_time_difference_ms"]), default=0.0)
    if late > tolerances.time_ms:
        found.append(f"detection differs by {late:.3f} ms")
    off = max(metrics["x_c_error_m"], default=0.0)
    if not off <= tolerances.x_c_m:
        found.append(f"x_c differs by {1e3 * off:.3f} mm")
    return found


def _estimator(
    recorded: Outputs, replayed: Outputs, context: Context
) -> tuple[Metrics, list[str]]:
    metrics: Metrics = {"position": None, "velocity": None, "attitude": None}
    found: list[str] = []
    if "odometry_position" in recorded.series:
        for name, unit in (("position", "m"), ("velocity", "m_s")):
            series = f"odometry_{name}"
            metrics[name] = compare_series(recorded.series[series], replayed.series[series], unit)
        metrics["attitude"] = compare_attitudes(
            recorded.series["odometry_attitude"], replayed.series["odometry_attitude"]
        )
        found = _over(metrics["position"], "m", context.tolerances.odometry_m, "position")
    return metrics, found


def _mission(recorded: Outputs, replayed: Outputs, context: Context) -> tuple[Metrics, list[str]]:
    metrics, found = _setpoint(recorded, replayed, "mission_setpoint", context)
    bounds = (0, len(PHASE_NAMES) - 1)
    before, after = (_changes(outputs, "phase", bounds) for outputs in (recorded, replayed))
    names = [[PHASE_NAMES[int(phase)] for _, (phase,) in phases] for phases in (before, after)]
    metrics["phases_recorded"], metrics["phases_replayed"] = names
    same = names[0] == names[1]
    metrics["phase_time_difference_ms"] = (
        [(b - a) / 1e6 for (a, _), (b, _) in zip(before, after, strict=True)] if same else None
    )
    if before and not same:
        found.append(f"phases {', '.join(names[1])} instead of {', '.join(names[0])}")
    return metrics, found


def _setpoint(
    recorded: Outputs, replayed: Outputs, name: str, context: Context
) -> tuple[Metrics, list[str]]:
    if name not in recorded.series:
        return {"setpoint": None}, []
    steps = compare_steps(recorded.series[name], replayed.series[name], "m")
    found = _over(steps, "m", context.tolerances.setpoint_m, "set point")
    return {"setpoint": steps}, found


def _changes(
    outputs: Outputs, name: str, bounds: tuple[float, float] = (-math.inf, math.inf)
) -> list[tuple[int, list[float]]]:
    """Return stamp and value, held within bounds, of each finite value that was new."""
    series = outputs.series.get(name)
    found: list[tuple[int, list[float]]] = []
    if series is None:
        return found
    values = np.clip(series.values, *bounds).tolist()
    for stamp, value in zip(series.stamp_ns.tolist(), values, strict=True):
        if all(map(math.isfinite, value)) and (not found or found[-1][1] != value):
            found.append((stamp, value))
    return found


def _reaction(recorded: Outputs, replayed: Outputs, context: Context) -> tuple[Metrics, list[str]]:
    metrics, found = _setpoint(recorded, replayed, "setpoint", context)
    metrics |= {"x_r_error_m": [], "switch_time_difference_ms": []}
    before, after = (_changes(outputs, "x_r") for outputs in (recorded, replayed))
    metrics["switches_recorded"], metrics["switches_replayed"] = len(before), len(after)
    for (time_a, x_a), (time_b, x_b) in zip(before, after, strict=False):
        metrics["switch_time_difference_ms"].append((time_b - time_a) / 1e6)
        metrics["x_r_error_m"].append(math.dist(x_a, x_b))
    if "x_r" in recorded.series and len(before) != len(after):
        found.append(f"{len(after)} switches to an x_r instead of {len(before)}")
    return metrics, found


def _controller(
    recorded: Outputs, replayed: Outputs, context: Context
) -> tuple[Metrics, list[str]]:
    name = "rotor_command"
    if name not in recorded.series:
        return {name: None}, []
    metrics = compare_series(recorded.series[name], replayed.series[name], "rad_s")
    tolerance = context.tolerances.command_rad_s
    return {name: metrics}, _over(metrics, "rad_s", tolerance, "rotor command")


def _over(metrics: Metrics, unit: str, tolerance: float, what: str) -> list[str]:
    if metrics["recorded"] and not metrics["compared"]:
        return [f"no {what} to compare with {metrics['recorded']} recorded ones"]
    rms = metrics[f"rms_{unit}"]
    if rms is not None and rms > tolerance:
        measure = "" if unit == what else f"{unit.replace('_', '/')} "
        return [f"{what} differs by {rms:.3g} {measure}RMS"]
    return []


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
    found: list[float | None] = []
    for event in events:
        before = [contact for contact in contacts_ns or [] if contact <= event.stamp_ns]
        found.append((event.known_ns - max(before)) / 1e6 if before else None)
    return found


def _per_minute(count: int, context: Context) -> float | None:
    return count / context.minutes if context.minutes > 0.0 else None


_METRICS: dict[str, Callable[[Outputs, Outputs, Context], tuple[Metrics, list[str]]]] = {
    "detector": _detector,
    "mission": _mission,
    "reaction": _reaction,
    "estimator": _estimator,
    "controller": _controller,
}

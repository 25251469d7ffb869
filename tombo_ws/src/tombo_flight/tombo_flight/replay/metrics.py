"""Figures of each node, recorded and replayed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tombo_dynamics.messages import PHASE_NAMES
from tombo_flight.replay.compare import (
    Tolerances,
    compare_attitudes,
    compare_events,
    compare_series,
    compare_steps,
    event_metrics,
)
from tombo_flight.replay.outputs import Event, Outputs

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


def _false_alarms(events: Sequence[Event], contacts_ns: Sequence[int]) -> int:
    """Count innovation events before the first true contact; a region may rightly be early."""
    first = min(contacts_ns, default=None)
    return sum(
        first is None or (event.trigger != "region" and event.stamp_ns < first) for event in events
    )


def _latencies_ms(events: Sequence[Event], contacts_ns: list[int] | None) -> list[float | None]:
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

"""Compare the recorded messages of each node with those of its replay."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pandas as pd

from tombo_bag.topics import (
    COLLISION_EVENT,
    CONTACT_EVENT,
    DETECTOR_STATUS,
    GOAL_POSE,
    MISSION_SETPOINT,
    MISSION_STATUS,
    MOCAP_POSE,
    ODOMETRY,
    REACTION_STATUS,
    ROTOR_COMMAND,
    SETPOINT,
)
from tombo_dynamics.arrays import Array, Times
from tombo_dynamics.messages import PHASE_NAMES, CollisionEvent, Trigger
from tombo_flight.flight_metrics import TRIGGER_NAMES
from tombo_sim.wiring import CORES

STEP_NS: Final = 25_000_000
"""A set point may change this much earlier or later: a period of the mission, and a bit."""
_MATCH_NS: Final = 500_000_000
"""Events further apart than this are two events."""
_X_C_M: Final = 1e-3
"""Difference of the estimated place of a collision that is none [m]."""

Stream = tuple[Times, Sequence[Any]]
"""Arrivals and messages of a topic."""
NOTHING: Final[Stream] = (np.zeros(0, np.int64), [])

OPTIONAL_INPUTS: Final[dict[str, tuple[str, ...]]] = {
    "mission": (REACTION_STATUS.name, SETPOINT.name, GOAL_POSE.name),
    "reaction": (
        *(MOCAP_POSE.name, DETECTOR_STATUS.name, COLLISION_EVENT.name, CONTACT_EVENT.name),
    ),
    "estimator": (MISSION_STATUS.name,),
}
"""Node → topics that are fed if they are there."""
NODES: Final = {core.name: core for core in CORES}


def needed_inputs(node: str) -> list[str]:
    """Return the topics without which a node can't be replayed."""
    return [t for t in NODES[node].inputs if t not in OPTIONAL_INPUTS.get(node, ())]


def _lengths(recorded: Stream, replayed: Stream, name: str) -> Array:
    """Return the lengths of the differences of a field, in messages of one stamp."""
    a, b = _aligned(recorded, replayed, name)
    return np.asarray(np.linalg.norm(b - a, axis=1))


def _angles(recorded: Stream, replayed: Stream, name: str) -> Array:
    """Return the angles between quaternions of one stamp [rad]."""
    a, b = _aligned(recorded, replayed, name)
    cosine = np.abs(np.sum(a * b, axis=1))
    return np.asarray(2.0 * np.arccos(np.minimum(cosine, 1.0)))


def _aligned(recorded: Stream, replayed: Stream, name: str) -> tuple[Array, Array]:
    """Return a field in the messages of both with the nearest stamps.

    A recorded message without a replayed one within 0.6 of the usual step has no partner.
    """
    (stamps, a), (others, b) = _series(recorded, name), _series(replayed, name)
    steps = np.diff(np.sort(stamps))
    near_ns = max(int(0.6 * np.median(steps)) if steps.size else 0, 1000)
    left, right = (
        pd.DataFrame({"stamp": at, row: np.arange(at.size)}).sort_values("stamp", kind="stable")
        for at, row in ((stamps, "a"), (others, "b"))
    )
    both = pd.merge_asof(left, right, on="stamp", direction="nearest", tolerance=near_ns).dropna()
    return a[both["a"].to_numpy()], b[both["b"].to_numpy(int)]


def _steps(recorded: Stream, replayed: Stream, name: str) -> Array:
    """Return the lengths of the differences of what holds until the next message.

    A step may come `STEP_NS` earlier or later: that much lies between two clocks' readings of one
    moment.
    """
    (at, wanted), (stamps, values) = _series(recorded, name), _series(replayed, name)
    order = np.argsort(stamps, kind="stable")
    stamps, values = stamps[order], values[order]
    sizes: Array = np.full((3, at.size), np.nan)
    for size, shift in zip(sizes, (0, -STEP_NS, STEP_NS), strict=True):
        row = np.searchsorted(stamps, at + shift, side="right") - 1
        there = row >= 0
        size[there] = np.linalg.norm(values[row[there]] - wanted[there], axis=1)
    return np.asarray(np.fmin.reduce(sizes[:, ~np.isnan(sizes[0])], axis=0))


def _series(stream: Stream, name: str) -> tuple[Times, Array]:
    """Return the stamps (N,) of messages, and a field of them (N, k)."""
    _, messages = stream
    stamps = np.array([message.stamp_ns for message in messages], np.int64)
    values = np.array([getattr(message, name) for message in messages], np.float64)
    return stamps, values.reshape(stamps.size, -1)


@dataclass(frozen=True)
class Series:
    """A field of a topic, and how it is compared."""

    key: str
    """Key of the figures."""
    name: str
    """Name on a page."""
    topic: str
    field: str
    unit: str
    tolerance: float = math.inf
    """Largest RMS difference that is none."""
    differences: Callable[[Stream, Stream, str], Array] = _lengths


SERIES: Final[dict[str, tuple[Series, ...]]] = {
    "detector": (
        Series("statistic", "statistic", DETECTOR_STATUS.name, "statistic", "statistic", 0.1),
    ),
    "mission": (
        Series("setpoint", "set point", MISSION_SETPOINT.name, "position", "m", 0.01, _steps),
    ),
    "reaction": (Series("setpoint", "set point", SETPOINT.name, "position", "m", 0.01, _steps),),
    "estimator": (
        Series("position", "position", ODOMETRY.name, "position", "m", 5e-3),
        Series("velocity", "velocity", ODOMETRY.name, "velocity", "m_s"),
        Series("attitude", "attitude", ODOMETRY.name, "attitude", "rad", math.inf, _angles),
    ),
    "controller": (
        Series("rotor_command", "rotor command", ROTOR_COMMAND.name, "speed", "rad_s", 5.0),
    ),
}
"""Node → its series."""


@dataclass
class NodeComparison:
    """How far a node's replay differs from its recording."""

    values: dict[str, Any] = field(default_factory=dict)
    """Figures, for programs."""
    rows: list[tuple[str, str]] = field(default_factory=list)
    """Name and text of each figure on a page."""
    differences: list[str] = field(default_factory=list)
    """Figures beyond their tolerances."""


def compare_streams(
    node: str,
    recorded: Mapping[str, Stream],
    replayed: Mapping[str, Stream],
    begin_ns: int,
    contacts_ns: Sequence[int] | None,
) -> NodeComparison:
    """Compare what a node has published.

    Args:
        node: its name.
        recorded: topic → messages; of a topic that nobody recorded there is none.
        replayed: the same of the replay.
        begin_ns: from here figures count the time.
        contacts_ns: true contacts; None: the truth is not known.
    """
    found = NodeComparison()
    if node == "detector":
        before = recorded.get(COLLISION_EVENT.name)
        after = replayed.get(COLLISION_EVENT.name, NOTHING)
        _compare_events(found, before, after, begin_ns, contacts_ns)
    for series in SERIES.get(node, ()):
        before = recorded.get(series.topic, NOTHING)
        _compare_series(found, series, before, replayed.get(series.topic, NOTHING))
    for of, topic, name, compare in (
        ("mission", MISSION_STATUS.name, "phase", _compare_phases),
        ("reaction", REACTION_STATUS.name, "x_r", _compare_switches),
    ):
        if of == node:
            compare(found, *(_changes(s.get(topic, NOTHING), name) for s in (recorded, replayed)))
    return found


def _compare_series(
    found: NodeComparison, series: Series, recorded: Stream, replayed: Stream
) -> None:
    """Add RMS and largest difference."""
    if not recorded[1]:
        found.values[series.key] = None
        found.rows.append((series.name, "not recorded"))
        return
    differences = series.differences(recorded, replayed, series.field)
    finite = differences[np.isfinite(differences)]
    rms = float(np.sqrt(np.mean(finite**2))) if finite.size else None
    most = float(finite.max()) if finite.size else None
    found.values[series.key] = {
        "recorded": len(recorded[1]),
        "replayed": len(replayed[1]),
        "compared": len(differences),
        f"rms_{series.unit}": rms,
        f"max_{series.unit}": most,
    }
    unit = {"statistic": "", "m_s": " m/s", "rad_s": " rad/s"}.get(series.unit, f" {series.unit}")
    sizes = f"{_number(rms, 6)}{unit} RMS, {_number(most, 6)} at most"
    found.rows.append((series.name, f"differs by {sizes} ({len(differences)} compared)"))
    if not len(differences):
        count = len(recorded[1])
        found.differences.append(f"no {series.name} to compare with {count} recorded ones")
    elif rms is not None and rms > series.tolerance:
        found.differences.append(f"{series.name} differs by {rms:.3g}{unit} RMS")


def _compare_events(
    found: NodeComparison,
    recorded: Stream | None,
    replayed: Stream,
    begin_ns: int,
    contacts_ns: Sequence[int] | None,
) -> None:
    """Add the collisions of the detector; None: nobody recorded them."""
    after = list(zip(*replayed, strict=True))
    events = [_event(known_ns, message, begin_ns) for known_ns, message in after]
    latencies = [_latency_ms(known_ns, message, contacts_ns or ()) for known_ns, message in after]
    first = min(contacts_ns, default=math.inf) if contacts_ns is not None else None
    alarms = None if first is None else sum(_is_false(message, first) for _, message in after)
    figures: dict[str, Any] = {"events_recorded": None, "events_replayed": events}
    row = f"{len(events)} replayed, none recorded (no topic)"
    if recorded is not None:
        before = list(zip(*recorded, strict=True))
        figures["events_recorded"] = [_event(*event, begin_ns) for event in before]
        pairs = _pairs([m.stamp_ns for _, m in before], [m.stamp_ns for _, m in after])
        matched = [(*before[i], *after[j]) for i, j in pairs]
        figures |= {
            "matched": len(matched),
            "missed": len(before) - len(matched),
            "extra": len(after) - len(matched),
            "detection_time_difference_ms": [
                (b.stamp_ns - a.stamp_ns) / 1e6 for _, a, _, b in matched
            ],
            "known_time_difference_ms": [(b_ns - a_ns) / 1e6 for a_ns, _, b_ns, _ in matched],
            "x_c_error_m": [
                math.dist(a.contact_position, b.contact_position) for _, a, _, b in matched
            ],
        }
        counts = "{matched} matched, {missed} missed, {extra} extra".format_map(figures)
        row = f"{len(before)} recorded, {len(after)} replayed: {counts}"
    found.rows.append(("events", row))
    for event in events:
        x, y, z = event["x_c_m"]
        words = (
            f"at {event['stamp_s']:.3f} s ({event['trigger']}), known at {event['known_s']:.3f} s,"
            f" statistic {event['statistic']:.0f}, x_c {x:.3f} {y:.3f} {z:.3f} m"
        )
        found.rows.append(("  event", words))
    if recorded is not None:
        late, off = figures["detection_time_difference_ms"], figures["x_c_error_m"]
        if recorded[1]:
            found.rows.append(("detection time", f"{_list(late, 3)} ms"))
            found.rows.append(("x_c", f"{_list(off, 6)} m"))
        for what in ("missed", "extra"):
            if (count := figures[what]) > 0:
                found.differences.append(f"{count} event{'s' * (count > 1)} {what}")
        if any(late):
            found.differences.append(f"detection differs by {max(map(abs, late)):.3f} ms")
        if not max(off, default=0.0) <= _X_C_M:
            found.differences.append(f"x_c differs by {1e3 * max(off):.3f} mm")
    if alarms is not None:
        found.rows.append(("false alarms", str(alarms)))
    if any(value is not None for value in latencies):
        found.rows.append(("true contact to event", f"{_list(latencies, 1)} ms"))
    found.values |= {**figures, "false_alarms": alarms, "latency_ms": latencies}


def _event(known_ns: int, message: CollisionEvent, begin_ns: int) -> dict[str, Any]:
    """Return an event as plain values; times in seconds after `begin_ns`."""
    return {
        "stamp_s": (message.stamp_ns - begin_ns) / 1e9,
        "known_s": (known_ns - begin_ns) / 1e9,
        "trigger": TRIGGER_NAMES.get(message.trigger, "unknown"),
        "x_c_m": message.contact_position.tolist(),
        "flight_direction": message.flight_direction.tolist(),
        "statistic": message.statistic,
        "confidence": message.confidence,
    }


def _pairs(recorded: Sequence[int], replayed: Sequence[int]) -> list[tuple[int, int]]:
    """Match events by the nearest stamps [ns]; return the rows of each pair."""
    distances = sorted(
        (abs(a - b), i, j)
        for i, a in enumerate(recorded)
        for j, b in enumerate(replayed)
        if abs(a - b) <= _MATCH_NS
    )
    taken: dict[int, int] = {}
    for _, i, j in distances:
        if i not in taken and j not in taken.values():
            taken[i] = j
    return sorted(taken.items())


def _is_false(message: CollisionEvent, first_contact_ns: float) -> bool:
    """Whether an event came before the first true contact; a region's may rightly be early."""
    early = message.stamp_ns < first_contact_ns and message.trigger != Trigger.REGION
    return early or math.isinf(first_contact_ns)


def _latency_ms(
    known_ns: int, message: CollisionEvent, contacts_ns: Sequence[int]
) -> float | None:
    """Return the time from the newest true contact before an event until it was known."""
    before = [contact for contact in contacts_ns if contact <= message.stamp_ns]
    return (known_ns - max(before)) / 1e6 if before else None


def _changes(stream: Stream, name: str) -> list[tuple[int, list[float]]]:
    """Return stamp and value of a field in each message that has changed it to finite values."""
    changes: list[tuple[int, list[float]]] = []
    for stamp, value in zip(*(part.tolist() for part in _series(stream, name)), strict=True):
        if all(map(math.isfinite, value)) and (not changes or changes[-1][1] != value):
            changes.append((stamp, value))
    return changes


_Change = tuple[int, list[float]]


def _compare_phases(
    found: NodeComparison, before: Sequence[_Change], after: Sequence[_Change]
) -> None:
    last = len(PHASE_NAMES) - 1
    recorded, replayed = (
        [PHASE_NAMES[min(max(int(phase), 0), last)] for _, (phase,) in changes]
        for changes in (before, after)
    )
    times = [(b - a) / 1e6 for (a, _), (b, _) in zip(before, after, strict=False)]
    same = recorded == replayed
    found.values |= {
        "phases_recorded": recorded,
        "phases_replayed": replayed,
        "phase_time_difference_ms": times if same else None,
    }
    found.rows.append(("phases", ", ".join(replayed)))
    if same and times:
        found.rows.append(("phases begin", f"{_list(times, 0)} ms"))
    if before and not same:
        found.differences.append(f"phases {', '.join(replayed)} instead of {', '.join(recorded)}")


def _compare_switches(
    found: NodeComparison, before: Sequence[_Change], after: Sequence[_Change]
) -> None:
    both = list(zip(before, after, strict=False))
    times = [(b - a) / 1e6 for (a, _), (b, _) in both]
    errors = [math.dist(a, b) for (_, a), (_, b) in both]
    found.values |= {
        "switches_recorded": len(before),
        "switches_replayed": len(after),
        "switch_time_difference_ms": times,
        "x_r_error_m": errors,
    }
    found.rows.append(("switches", f"{len(before)} recorded, {len(after)} replayed"))
    if errors:
        found.rows.append(("x_r", f"{_list(errors, 6)} m"))
        found.rows.append(("switch time", f"{_list(times, 1)} ms"))
    if before and len(before) != len(after):
        found.differences.append(f"{len(after)} switches to an x_r instead of {len(before)}")


def _list(values: Sequence[float | None], digits: int) -> str:
    return ", ".join(_number(value, digits) for value in values) or "-"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{round(value, digits):.10g}"

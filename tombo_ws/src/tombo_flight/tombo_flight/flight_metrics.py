"""The figures of a flight, all from the ground truth: what `summary.json` holds.

Definitions are those of `docs/figures.md`; each function says its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.flight import Flight
from tombo_bag.message_codec import as_messages
from tombo_bag.topics import (
    COLLISION_EVENT,
    CONTACT_EVENT,
    DETECTOR_STATUS,
    MOCAP_POSE,
    REACTION_STATUS,
)
from tombo_collision.decision import Decision
from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.messages import PHASE_NAMES, ROTOR_UNKNOWN, CollisionEvent, Phase, Trigger
from tombo_dynamics.rotation import tilt, up_in_body
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES, VehicleParams
from tombo_flight.scenario import Scenario

STABLE_TILT = 0.17
STABLE_RATE = 1.0
_STABLE_TIME = 0.3
_SETTLED_RADIUS = 0.1
_SETTLED_SPEED = 0.1
_SETTLED_TIME = 1.0
_OVERTURNED = 2.1
_HARD_LANDING_SPEED = 1.0
"""[m/s]: a leg need not bear more. A rotorcraft's gear is tested by a level drop of 0.2 m, 2 m/s
(CS 27.725: at least 8 inches); of four legs the one that touches first bears a quarter of that
energy. PX4 lands at 0.7 m/s (MPC_LAND_SPEED)."""
_LANDS_WITHIN = 3.0
"""[m]: twice the drift of a descent without a position."""
_LANDS_BELOW = 0.5
_IMU = Trigger.IMU.name.lower()
TRIGGER_NAMES = {int(trigger): trigger.name.lower() for trigger in Trigger}


@dataclass(frozen=True)
class Detection:
    """A collision that was published, in flight time [s]."""

    known_s: float
    """When it was known."""
    stamp_s: float
    """Capture time of the sample that triggered."""
    contact_time_s: float
    """Estimated time of contact."""
    trigger: str
    """'region' or 'innovation'; 'imu': seen by the controller."""
    message: CollisionEvent


def event(time_s: float, kind: str, text: str, **more: Any) -> dict[str, Any]:
    """Return an event of the record: what happened at a time [s]."""
    return {"time_s": float(time_s), "kind": kind, "text": text, **more}


def phase_event(time_s: float, phase: float) -> dict[str, Any]:
    """Return the beginning of a phase as an event of the record."""
    name = PHASE_NAMES[int(phase)] if phase < len(PHASE_NAMES) else "?"
    return event(time_s, name, name.replace("_", " "))


def collision_events(
    detections: Sequence[Detection], decisions: Sequence[Decision], decided_s: Sequence[float]
) -> list[dict[str, Any]]:
    """Return detections, and the decisions after them, made at times [s], as events."""
    found = [
        event(
            seen.known_s,
            "detection",
            f"collision detected ({seen.trigger})",
            trigger=seen.trigger,
            stamp_s=seen.stamp_s,
            contact_time_s=seen.contact_time_s,
            x_c_m=seen.message.contact_position.tolist(),
            flight_direction=seen.message.flight_direction.tolist(),
            confidence=seen.message.confidence,
            statistic=seen.message.statistic,
            count=seen.message.count,
        )
        for seen in detections
    ]
    for count, (decision, at_s) in enumerate(zip(decisions, decided_s, strict=True), 1):
        places = {f"{name}_m": getattr(decision, name).tolist() for name in ("x_c", "x_r")}
        more = {**places, "n_r": decision.n_r.tolist(), "count": count}
        found.append(event(at_s, "setpoint_switch", "set point moved to x_r", **more))
    return found


def with_figures(
    flight: Flight,
    scenario: Scenario,
    seed: int,
    wall_time_s: float,
    phases: Sequence[dict[str, Any]],
) -> Flight:
    """Return a flight with its summary, and with what happened in it.

    Args:
        flight: topics and ticks of it.
        scenario: as flown.
        seed: as flown.
        wall_time_s: how long the flight took.
        phases: `phase_event` of each phase that has begun.
    """
    detections = _detections(flight, scenario)
    decisions, decided_s = _decisions(flight)
    summary, seen = summarize(flight, scenario, seed, detections, decisions, wall_time_s)
    events = [*collision_events(detections, decisions, decided_s), *phases, *seen]
    events.sort(key=lambda event: float(event["time_s"]))
    return replace(flight, summary=summary, events=events)


def _detections(flight: Flight, scenario: Scenario) -> list[Detection]:
    """Return the collisions of detector and reaction, in the order in which they were known."""
    topics = {COLLISION_EVENT.name, *scenario.reaction.event_topics()}
    found = []
    for name in (COLLISION_EVENT.name, CONTACT_EVENT.name):
        if name in topics and (topic := flight.topics.get(name)) is not None:
            columns = {field: series.values for field, series in topic.items()}
            columns.setdefault("frame_id", np.full(topic.t.size, FRAME_MAP))
            events = as_messages(CollisionEvent, columns)
            found += [
                detection_of(event, float(at_s), flight.epoch_ns)
                for at_s, event in zip(topic.arrival, events, strict=True)
            ]
    return sorted(found, key=attrgetter("known_s"))


def detection_of(message: CollisionEvent, known_s: float, epoch_ns: int) -> Detection:
    """Return a published collision in flight time, whose zero is stamp `epoch_ns`."""
    stamp_s, contact_s = (
        (stamp_ns - epoch_ns) * 1e-9 for stamp_ns in (message.stamp_ns, message.contact_stamp_ns)
    )
    trigger = TRIGGER_NAMES.get(message.trigger, "unknown")
    return Detection(known_s, stamp_s, contact_s, trigger, message)


def _decisions(flight: Flight) -> tuple[list[Decision], list[float]]:
    """Return the decisions of the reaction, and when each was made [s]."""
    status = flight.topics.get(REACTION_STATUS.name)
    if status is None:
        return [], []
    count, x_r = status["collisions"].values, status["x_r"].values
    known = np.maximum.accumulate(np.where(np.isfinite(x_r).all(axis=1), count, 0))
    rows = np.flatnonzero(np.diff(known, prepend=0) > 0)
    x_c, n_r = status["x_c"].values, status["n_r"].values
    return [Decision(x_c[i], n_r[i], x_r[i]) for i in rows], status.t[rows].tolist()


def statistic_of_poses(flight: Flight) -> Array:
    """Return the detector's statistic of each pose of the motion capture, 0 where none is."""
    captured = flight[MOCAP_POSE.name].t
    status = flight.topics.get(DETECTOR_STATUS.name)
    if status is None:
        return np.zeros(captured.size)
    stamps, wanted = (np.rint(1e6 * t).astype(np.int64) for t in (status.t, captured))
    values = status["statistic"].values
    if stamps.size == wanted.size and not (np.abs(stamps - wanted) > 1).any():
        return np.array(values)
    of_stamp = dict(zip(stamps.tolist(), values.tolist(), strict=True))
    return np.array([of_stamp.get(stamp, 0.0) for stamp in wanted.tolist()])


def first_sustained(condition: NDArray[np.bool_], length: int) -> int | None:
    """Return the first index of `length` successive entries that hold, or None."""
    if condition.size < length:
        return None
    broken = np.concatenate([[0], np.cumsum(~condition)])
    whole = broken[length:] == broken[: broken.size - length]
    return int(np.argmax(whole)) if whole.any() else None


def lowest_point(vehicle: VehicleParams, position: Array, attitude: Array) -> Array:
    """Return the height of the lowest point of legs and motors (N,) [m]."""
    return np.minimum(*_lowest_points(vehicle, position, attitude))


def _lowest_points(
    vehicle: VehicleParams, position: Array, attitude: Array
) -> tuple[Array, Array]:
    """Return the heights of the lowest leg and of the lowest motor, (N,) each [m]."""
    up = up_in_body(attitude)
    spread = vehicle.leg_spread * math.sqrt(2.0)
    legs, motors = (
        position[:, 2]
        + np.min(
            [up @ [reach * x, reach * y, z] for x, y in zip(ARM_X, ARM_Y, strict=True)], axis=0
        )
        for reach, z in ((spread, -vehicle.leg_height), (vehicle.arm_length, vehicle.rotor_height))
    )
    return legs, motors


def squares(vectors: Array) -> Array:
    """Return the squared lengths of vectors (N, 3), added up from x to z."""
    x, y, z = vectors.T  # a sum over the short axis takes ten times as long
    squares: Array = x * x + y * y + z * z
    return squares


def _number(value: float | None, digits: int = 6) -> float | None:
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits) + 0.0  # no minus before a zero


def summarize(
    flight: Flight,
    scenario: Scenario,
    seed: int,
    detections: Sequence[Detection],
    decisions: Sequence[Decision],
    wall_time_s: float,
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the summary and the events that only the truth shows (contact, settled, crash).

    Args:
        flight: `t` and `log` of it, with at least the `FIGURE_COLUMNS` of `tombo_sim.kernel`.
        scenario: as flown.
        seed: as flown.
        detections: the collisions that were known, in this order.
        decisions: of the reaction.
        wall_time_s: how long the flight took.
    """
    log, t = flight.log, flight.t
    vehicle = scenario.vehicle
    events: list[dict[str, Any]] = []
    phases = log["mode"][:, 0]
    touching = log["contact"][:, 0] > 0.0
    collided = bool(touching.any())
    c = int(np.argmax(touching)) if collided else None

    tilted = tilt(log["attitude"])

    crash = _crash(vehicle, log, tilted)
    if crash is not None:
        events.append(event(t[crash], "crash", "crashed"))
    where_else = _elsewhere(vehicle, log, tilted) if t.size else ""
    propeller = scenario.propeller
    summary: dict[str, Any] = {
        "scenario": scenario.name,
        "model": scenario.model or None,
        "seed": seed,
        "conf": None if propeller.plain else propeller.conf,
        "law": None if propeller.plain else propeller.law,
        "reaction": scenario.reaction.name,
        "disturbances": scenario.disturbances,
        "collided": collided,
        "collision_time_s": None,
        "contact_point_m": None,
        "contact_rotor": None,
        "contact_position_m": None,
    }
    if c is not None:
        rotor = int(log["contact"][c, 1])
        name = "frame" if rotor < 0 else ROTOR_NAMES[rotor]
        summary["collision_time_s"] = _number(t[c])
        summary["contact_point_m"] = [_number(v) for v in log["contact"][c, 2:5]]
        summary["contact_rotor"] = name
        summary["contact_position_m"] = [_number(v) for v in log["position"][c]]
        events.append(event(t[c], "contact", f"{name.replace('_', ' ')} touches"))
    contact_s = None if c is None else float(t[c])
    summary |= _detection(contact_s, scenario.obstacle.radius > 0.0, detections, decisions)
    summary |= _recovery(flight, decisions, c, tilted, events)
    broken = log["damage"] >= 1.0
    if broken.any():
        first = int(np.argmax(broken.any(axis=1)))
        events.append(event(t[first], "rotor_broken", "a blade tears off"))
    summary |= {
        "strikes": _strikes(log["fold"]),
        "peak_contact_force_n": _number(_largest(log["contact_force"][c:])) if collided else None,
        "rotors_broken": int(broken[-1].sum()) if t.size else 0,
        "crashed": crash is not None,
        "crash_time_s": None if crash is None else _number(t[crash]),
        "landed": bool(t.size and phases[-1] == Phase.LANDED and crash is None and not where_else),
        "ends_elsewhere": where_else or None,
        "max_tilt_rad": _number(tilted[c or 0 :].max()) if t.size else None,
        "duration_s": _number(t[-1] + TICK_S) if t.size else 0.0,
    }
    summary |= _tracking(flight, c)
    summary["wall_time_s"] = wall_time_s
    summary["real_time_factor"] = (
        summary["duration_s"] / wall_time_s if wall_time_s > 0.0 else None
    )
    return summary, events


def _crash(vehicle: VehicleParams, log: Mapping[str, Array], tilted: Array) -> int | None:
    """Return the tick of the crash, or None.

    After it has flown, whoever lands it: a motor touches the ground, the legs hit it at more than
    1 m/s, or tilt stays beyond 2.1 rad to the end.
    """
    position, attitude = log["position"], log["attitude"]
    flown = np.flatnonzero(position[:, 2] > vehicle.leg_height + 0.3)
    if not flown.size:
        return None
    where = flown[0] + np.flatnonzero(position[flown[0] :, 2] < 0.5)
    legs, motors = _lowest_points(vehicle, position[where], attitude[where])
    hard = -log["velocity"][where, 2] > _HARD_LANDING_SPEED
    hits = where[(motors < 0.0) | ((legs < 0.0) & hard)][:1].tolist()
    over = tilted > _OVERTURNED
    if over[-1]:
        hits.append(int(np.flatnonzero(~over)[-1]) + 1 if not over.all() else 0)
    return min(hits, default=None)


def _elsewhere(vehicle: VehicleParams, log: Mapping[str, Array], tilted: Array) -> str:
    """Return what keeps the end of a flight from being a landing; "" if nothing does."""
    position, setpoint = log["position"][-1], log["position_setpoint"][-1]
    away = float(np.hypot(*(position - setpoint)[:2]))
    found = []
    if away > _LANDS_WITHIN:
        found.append(f"{away:.1f} m beside its set point")
    if position[2] > vehicle.leg_height + _LANDS_BELOW:
        found.append(f"{position[2]:.1f} m up")
    if tilted[-1] > _OVERTURNED:
        found.append("overturned")
    return ", ".join(found)


def _detection(
    contact_s: float | None,
    obstacle: bool,
    detections: Sequence[Detection],
    decisions: Sequence[Decision],
) -> dict[str, Any]:
    """Latency from true contact to the detector's event, and to the first of any; false alarms.

    An innovation event before contact is a false alarm. A known region may rightly fire before
    contact, or prevent it: only without an obstacle is its event a false alarm.
    """
    contact = math.inf if contact_s is None else contact_s
    true = [
        seen
        for seen in detections
        if seen.stamp_s >= contact or (seen.trigger == "region" and obstacle)
    ]
    poses = [seen for seen in true if seen.trigger != _IMU]
    first = poses[0] if poses else None
    arrival = None if first is None else first.known_s
    known = min((seen.known_s for seen in true), default=None)
    by_imu = (seen.message.rotor for seen in true if seen.trigger == _IMU)
    # poses do not show the rotor
    struck = next((rotor for rotor in by_imu if rotor != ROTOR_UNKNOWN), None)
    # x_c, n_r and x_r belong together: after a second collision they are the second one's
    reaction = decisions[-1] if decisions else None
    x_c = reaction.x_c if reaction else first.message.contact_position if first else None
    return {
        "detected": first is not None,
        "detections": sum(seen.trigger != _IMU for seen in detections),
        "detection_time_s": _number(arrival),
        "detection_latency_s": _number(arrival - contact) if arrival is not None else None,
        "detection_confidence": _number(first.message.confidence) if first else None,
        "contact_known_s": _number(known - contact) if known is not None else None,
        "struck_rotor": None if struck is None else ROTOR_NAMES[struck],
        "false_alarms": len(detections) - len(true),
        "x_c_m": [_number(v) for v in x_c] if x_c is not None else None,
        "n_r": [_number(v) for v in reaction.n_r] if reaction else None,
        "x_r_m": [_number(v) for v in reaction.x_r] if reaction else None,
    }


def _recovery(
    flight: Flight,
    decisions: Sequence[Decision],
    c: int | None,
    tilted: Array,
    events: list[dict[str, Any]],
) -> dict[str, Any]:
    """Falling distance, unstable phase, recovery time and settled error (docs/figures.md)."""
    names = ("max_falling_distance_m", "unstable_phase_s", "recovery_time_s", "settled_error_m")
    result: dict[str, Any] = dict.fromkeys(names)
    if c is None:
        return result
    log = flight.log
    position = log["position"][c:]
    landing = np.flatnonzero(np.isin(log["mode"][c:, 0], (Phase.LAND, Phase.LANDED)))
    until = int(landing[0]) if landing.size else position.shape[0]
    calm = (tilted[c:] < STABLE_TILT) & (np.sqrt(squares(log["rates"][c:])) < STABLE_RATE)
    quiet = first_sustained(calm, round(_STABLE_TIME / TICK_S))
    result["unstable_phase_s"] = None if quiet is None else _number(quiet * TICK_S)
    settled = None
    if decisions:
        x_r = decisions[-1].x_r
        error = np.sqrt(squares(position[:until] - x_r))
        slow = np.sqrt(squares(log["velocity"][c : c + until])) < _SETTLED_SPEED
        settled = first_sustained((error < _SETTLED_RADIUS) & slow, round(_SETTLED_TIME / TICK_S))
        if settled is not None:
            result["recovery_time_s"] = _number(settled * TICK_S)
            result["settled_error_m"] = _number(error[settled:].mean())
            events.append(event(flight.t[c + settled], "settled", "settled at x_r"))
    falling = position[: until if settled is None else settled, 2]
    if falling.size:
        result["max_falling_distance_m"] = _number(position[0, 2] - falling.min())
    return result


def _strikes(fold: Array) -> int:
    """Count the times that a blade is folded up to more than half, over all rotors."""
    folded = fold > 0.5
    return int((folded[1:] & ~folded[:-1]).sum())


def _largest(vectors: Array) -> float:
    return float(np.sqrt(squares(vectors)).max())


def _tracking(flight: Flight, c: int | None) -> dict[str, Any]:
    """RMS distance from the set point, in hover and in the approach, before contact."""
    log = flight.log
    end = flight.t.size if c is None else c
    phases = log["mode"][:end, 0]

    def rms(phase: Phase) -> float | None:
        there = phases == phase
        away = squares(log["position"][:end][there] - log["position_setpoint"][:end][there])
        return _number(float(np.sqrt(np.mean(away)))) if away.size else None

    return {"hover_rms_m": rms(Phase.HOVER), "approach_rms_m": rms(Phase.APPROACH)}

"""Milestones of a flight in the terms of the paper: contact, unstable phase, recovery."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tombo_collision.reactions import DEFAULT
from tombo_collision.reactions.none import NoReaction
from tombo_dynamics import vehicle
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import PHASE_NAMES
from tombo_dynamics.rotation import yaw_pitch_roll

if TYPE_CHECKING:
    from tombo_bag.flight import Flight


ROTOR_NAMES: Final = tuple(name.replace("_", " ") for name in vehicle.ROTOR_NAMES)
FRONT_LEFT: Final = vehicle.ROTOR_NAMES.index("front_left")
"""The rotor that meets the obstacle in the paper's experiment."""
Point = tuple[float, float, float]


class FlightOutcome(Enum):
    """How a flight ended."""

    RECOVERED = "recovered"
    CRASHED = "crashed"
    NO_CONTACT = "no contact"
    NOT_SETTLED = "not settled"

    @classmethod
    def of(cls, summary: Mapping[str, Any]) -> FlightOutcome:
        """Return the outcome of a flight from its summary."""
        if summary["crashed"]:
            return cls.CRASHED
        if not summary["collided"]:
            return cls.NO_CONTACT
        return cls.NOT_SETTLED if summary["recovery_time_s"] is None else cls.RECOVERED


@dataclass(frozen=True)
class DrawnObstacle:
    """A vertical cylinder that stands on the ground; metres, map ENU."""

    x_m: float
    y_m: float
    radius_m: float
    top_m: float


@dataclass(frozen=True)
class Span:
    """An interval of one phase, [start_s, end_s]."""

    start_s: float
    end_s: float
    phase: int

    @property
    def name(self) -> str:
        """Name of the phase; an unknown number is shown as it is."""
        known = 0 <= self.phase < len(PHASE_NAMES)
        return PHASE_NAMES[self.phase].replace("_", " ") if known else f"phase {self.phase}"


@dataclass(frozen=True)
class FlightMilestones:
    """The instants and lengths that the figures and the report mark; None where absent.

    Times are seconds of the flight's clock, points (x, y, z) metres in map ENU.
    """

    verdict: FlightOutcome
    duration_s: float
    contact_s: float | None
    detection_s: float | None
    switch_s: float | None
    unstable_end_s: float | None
    recovery_end_s: float | None
    crash_s: float | None
    x_c_m: Point | None
    contact_point_m: Point | None
    x_r_m: Point | None
    n_r: Point | None
    fall_m: float | None
    phases: tuple[Span, ...]
    obstacle: DrawnObstacle | None

    @property
    def mark_s(self) -> float | None:
        """The instant that the figures zoom on: the contact, else the crash, else detection."""
        return next(
            (t for t in (self.contact_s, self.crash_s, self.detection_s) if t is not None), None
        )


def reaction_words(name: str) -> str | None:
    """Return how a title says what was done about a collision; None: the paper's reaction was."""
    if name == NoReaction.name:
        return "without the reaction"
    return None if name == DEFAULT else f"reaction {name}"


def find_milestones(flight: Flight) -> FlightMilestones:
    """Find the milestones of a flight in its summary, its events and its ground truth.

    An interrupted flight, one without contact and a crash have milestones too: None for events
    that did not happen.
    """
    summary = flight.summary
    contact_s, known_s = summary["collision_time_s"], summary["contact_known_s"]
    # the detection of the contact; a false alarm long before it is another one
    detection_s = _after(contact_s, known_s)
    if detection_s is None:
        detection_s = first_event_s(flight, "detection")
    x_c = summary["x_c_m"]
    if contact_s is not None:
        x_c = x_c or flight.log["position"][nearest(flight.t, contact_s)].tolist()
    return FlightMilestones(
        verdict=FlightOutcome.of(summary),
        duration_s=float(flight.t[-1]),
        contact_s=contact_s,
        detection_s=detection_s,
        switch_s=first_event_s(flight, "setpoint_switch", detection_s),
        unstable_end_s=_after(contact_s, summary["unstable_phase_s"]),
        recovery_end_s=_after(contact_s, summary["recovery_time_s"]),
        crash_s=first_event_s(flight, "crash"),
        x_c_m=_point(x_c),
        contact_point_m=_point(summary["contact_point_m"]),
        x_r_m=_point(summary["x_r_m"]),
        n_r=_point(summary["n_r"]),
        fall_m=summary["max_falling_distance_m"],
        phases=phase_spans(flight.t, flight.log["mode"].reshape(-1)),
        obstacle=drawn_obstacle(flight.scenario),
    )


def first_event_s(flight: Flight, kind: str, after_s: float | None = None) -> float | None:
    """Return the time of the first event of a kind, not before `after_s`; None: there is none."""
    early = -math.inf if after_s is None else after_s - 1e-6
    times = (float(event["time_s"]) for event in flight.events if event["kind"] == kind)
    return min((t for t in times if t >= early), default=None)


def nearest(t: Array, time_s: float) -> int:
    """Return the index of the sample of `t` (ascending, not empty) closest to `time_s`."""
    after = int(np.clip(np.searchsorted(t, time_s), 0, len(t) - 1))
    before = max(after - 1, 0)
    return before if time_s - t[before] < t[after] - time_s else after


def phase_spans(t: Array, phase: NDArray[Any]) -> tuple[Span, ...]:
    """Return intervals of constant phase; a span ends where the next one starts.

    Args:
        t: (N,) times [s].
        phase: (N,) numbers of phases.
    """
    starts = np.concatenate(([0], np.flatnonzero(np.diff(phase)) + 1))
    ends = np.append(starts[1:], len(t) - 1)
    return tuple(
        Span(float(t[a]), float(t[b]), int(phase[a])) for a, b in zip(starts, ends, strict=True)
    )


def roll_pitch_yaw_deg(attitude: Array) -> Array:
    """Return (N, 3) roll, pitch, yaw in degrees of (N, 4) quaternions xyzw, map<-base_link.

    Within +-180; NaN stands where an angle jumps from one end to the other, to break the line.
    """
    angles: Array = np.degrees(yaw_pitch_roll(np.asarray(attitude, dtype=np.float64))[:, ::-1])
    angles[1:][np.abs(np.diff(angles, axis=0)) > 180.0] = np.nan
    return angles


def drawn_obstacle(scenario: Mapping[str, Any]) -> DrawnObstacle | None:
    """Return the obstacle of a scenario as flown; None: it has none."""
    values = scenario.get("obstacle") or {}
    if not values.get("radius_m") or not values.get("top_m"):
        return None
    return DrawnObstacle(*(float(values[key]) for key in ("x_m", "y_m", "radius_m", "top_m")))


def _after(start_s: float | None, length_s: float | None) -> float | None:
    return None if start_s is None or length_s is None else start_s + length_s


def _point(value: Any) -> Point | None:
    if value is None or None in value:
        return None
    return float(value[0]), float(value[1]), float(value[2])

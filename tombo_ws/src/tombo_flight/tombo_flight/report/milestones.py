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
from tombo_dynamics.messages import PHASE_NAMES, Phase
from tombo_dynamics.rotation import yaw_pitch_roll

if TYPE_CHECKING:
    from tombo_bag.flight import Flight


ROTOR_NAMES: Final = tuple(name.replace("_", " ") for name in vehicle.ROTOR_NAMES)
FRONT_LEFT: Final = vehicle.ROTOR_NAMES.index("front_left")
"""The rotor that meets the obstacle in the paper's experiment."""

UPRIGHT_RAD: Final = 0.17
"""Tilt below which the unstable phase can end."""


class FlightOutcome(Enum):
    """How a flight ended, as one word for the header."""

    RECOVERED = "recovered"
    CRASHED = "crashed"
    NO_CONTACT = "no contact"
    NOT_SETTLED = "not settled"


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

    name: str
    seed: int | None
    conf: int | None
    reaction: str | None
    verdict: FlightOutcome
    duration_s: float
    contact_s: float | None
    detection_s: float | None
    switch_s: float | None
    unstable_end_s: float | None
    recovery_end_s: float | None
    crash_s: float | None
    x_c_m: tuple[float, float, float] | None
    contact_point_m: tuple[float, float, float] | None
    x_r_m: tuple[float, float, float] | None
    n_r: tuple[float, float, float] | None
    contact_height_m: float | None
    lowest_s: float | None
    lowest_m: float | None
    phases: tuple[Span, ...]
    obstacle: DrawnObstacle | None

    @property
    def falling_distance_m(self) -> float | None:
        """Height at contact minus the lowest height until settled."""
        if self.contact_height_m is None or self.lowest_m is None:
            return None
        return self.contact_height_m - self.lowest_m

    @property
    def recovery_phase_s(self) -> float | None:
        """The paper's second phase: from the end of the unstable one until settled; else None."""
        if self.unstable_end_s is None or self.recovery_end_s is None:
            return None
        return max(0.0, self.recovery_end_s - self.unstable_end_s) or None  # settled before

    @property
    def bounce_m(self) -> float | None:
        """Distance from x_c to x_r."""
        if self.x_c_m is None or self.x_r_m is None:
            return None
        return math.dist(self.x_c_m, self.x_r_m)

    @property
    def falling_rate_m_s(self) -> float | None:
        """Mean rate of descent from contact to the lowest point."""
        if self.falling_distance_m is None or self.lowest_s is None or self.contact_s is None:
            return None
        elapsed_s = self.lowest_s - self.contact_s
        return self.falling_distance_m / elapsed_s if elapsed_s > 0.0 else None

    @property
    def mark_s(self) -> float | None:
        """The instant that the figures zoom on: the contact, else the crash, else detection."""
        return next(
            (t for t in (self.contact_s, self.crash_s, self.detection_s) if t is not None), None
        )


def reaction_words(name: str | None) -> str | None:
    """Return how a title says what was done about a collision; None: the paper's reaction was."""
    if name == NoReaction.name:
        return "without the reaction"
    return None if name in (None, DEFAULT) else f"reaction {name}"


def find_milestones(flight: Flight) -> FlightMilestones:
    """Find the milestones of a flight in its summary, its events and its ground truth.

    The summary has priority; events fill in what it leaves out. A flight that was interrupted, has
    no contact, or crashes has milestones too, with None for those that did not happen.
    """
    summary = flight.summary
    t = np.asarray(flight.t, dtype=np.float64)
    duration_s = float(t[-1]) if t.size else 0.0

    contact_s = number(summary, "collision_time_s")
    if contact_s is None:
        contact_s = first_event_s(flight, "contact")
    collided = _flag(summary, "collided", otherwise=contact_s is not None)
    if not collided:
        contact_s = None

    detection_s = _detection_s(flight, contact_s)
    switch_s = first_event_s(flight, "setpoint_switch", detection_s)
    unstable_s = number(summary, "unstable_phase_s")
    recovery_s = number(summary, "recovery_time_s")
    crash_s = first_event_s(flight, "crash")
    crashed = _flag(summary, "crashed", otherwise=crash_s is not None)

    contact_height_m = lowest_m = lowest_s = None
    if contact_s is not None and t.size:
        end_s = duration_s if recovery_s is None else contact_s + recovery_s
        contact_height_m, lowest_s, lowest_m = _fall(flight, contact_s, end_s)
        falling_distance_m = number(summary, "max_falling_distance_m")
        lowest_m = (
            lowest_m if falling_distance_m is None else contact_height_m - falling_distance_m
        )

    x_c = point(summary, "x_c_m")
    if x_c is None and contact_s is not None and t.size:
        at_contact = flight.log["position"][nearest(t, contact_s)]
        x_c = (float(at_contact[0]), float(at_contact[1]), float(at_contact[2]))

    return FlightMilestones(
        name=str(summary.get("scenario") or flight.scenario.get("name") or "flight"),
        seed=_integer(summary, "seed"),
        conf=_integer(summary, "conf"),
        reaction=summary.get("reaction"),
        verdict=_verdict(crashed, collided, recovery_s),
        duration_s=duration_s,
        contact_s=contact_s,
        detection_s=detection_s,
        switch_s=switch_s,
        unstable_end_s=_after(contact_s, unstable_s),
        recovery_end_s=_after(contact_s, recovery_s),
        crash_s=crash_s,
        x_c_m=x_c,
        contact_point_m=point(summary, "contact_point_m"),
        x_r_m=point(summary, "x_r_m"),
        n_r=point(summary, "n_r"),
        contact_height_m=contact_height_m,
        lowest_s=lowest_s,
        lowest_m=lowest_m,
        phases=phase_spans(t, flight.log["mode"].reshape(-1)),
        obstacle=drawn_obstacle(flight.scenario),
    )


def number(values: Mapping[str, Any], key: str) -> float | None:
    """The finite number under `key`, else None (absent, null, text, NaN, infinite)."""
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        return None
    return float(value) if math.isfinite(value) else None


def point(values: Mapping[str, Any], key: str) -> tuple[float, float, float] | None:
    """Three finite numbers under `key`, else None."""
    value = values.get(key)
    if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != 3:
        return None
    x, y, z = (number({key: item}, key) for item in value)
    return None if x is None or y is None or z is None else (x, y, z)


def first_event_s(flight: Flight, kind: str, after_s: float | None = None) -> float | None:
    """Time of the first event of this kind, not before `after_s`; None if there is none."""
    times = [number(event, "time_s") for event in flight.events if event.get("kind") == kind]
    early = -math.inf if after_s is None else after_s - 1e-6
    return min((t for t in times if t is not None and t >= early), default=None)


def nearest(t: Array, time_s: float) -> int:
    """Index of the sample of `t` (ascending, not empty) closest to `time_s`."""
    after = int(np.clip(np.searchsorted(t, time_s), 0, len(t) - 1))
    before = max(after - 1, 0)
    return before if time_s - t[before] < t[after] - time_s else after


def phase_spans(t: Array, phase: NDArray[Any]) -> tuple[Span, ...]:
    """Intervals of constant phase; `t` and `phase` are (N,), a span ends where the next starts."""
    if not len(t):
        return ()
    starts = np.concatenate(([0], np.flatnonzero(np.diff(phase)) + 1))
    ends = np.append(starts[1:], len(t) - 1)
    return tuple(
        Span(float(t[a]), float(t[b]), int(phase[a])) for a, b in zip(starts, ends, strict=True)
    )


def roll_pitch_yaw_deg(attitude: Array) -> Array:
    """(N, 4) quaternions xyzw, map<-base_link, to (N, 3) roll, pitch, yaw in degrees.

    Within +-180; NaN stands where an angle jumps from one end to the other, to break the line.
    """
    angles: Array = np.degrees(yaw_pitch_roll(np.asarray(attitude, dtype=np.float64))[:, ::-1])
    angles[1:][np.abs(np.diff(angles, axis=0)) > 180.0] = np.nan
    return angles


def _detection_s(flight: Flight, contact_s: float | None) -> float | None:
    """The detection that belongs to the contact; a false alarm long before it does not."""
    latency_s = number(flight.summary, "contact_known_s")
    if contact_s is not None and latency_s is not None:
        return contact_s + latency_s
    return first_event_s(flight, "detection")


def _fall(flight: Flight, contact_s: float, end_s: float) -> tuple[float, float, float]:
    """Height at contact, and when and how low the vehicle comes before `end_s` or the landing."""
    first, last = nearest(flight.t, contact_s), nearest(flight.t, end_s)
    heights = flight.log["position"][first : last + 1, 2]
    landing = np.flatnonzero(flight.log["mode"].reshape(-1)[first : last + 1] == Phase.LAND)
    lowest = int(np.argmin(heights[: landing[0] + 1] if landing.size else heights))
    return float(heights[0]), float(flight.t[first + lowest]), float(heights[lowest])


def _verdict(crashed: bool, collided: bool, recovery_s: float | None) -> FlightOutcome:
    if crashed:
        return FlightOutcome.CRASHED
    if not collided:
        return FlightOutcome.NO_CONTACT
    return FlightOutcome.RECOVERED if recovery_s is not None else FlightOutcome.NOT_SETTLED


def drawn_obstacle(scenario: Mapping[str, Any]) -> DrawnObstacle | None:
    """Return the obstacle of a scenario as flown; None: it has none."""
    values = scenario.get("obstacle")
    if not isinstance(values, Mapping):
        return None
    x_m, y_m = number(values, "x_m"), number(values, "y_m")
    radius_m, top_m = number(values, "radius_m"), number(values, "top_m")
    if x_m is None or y_m is None or not radius_m or not top_m:
        return None
    return DrawnObstacle(x_m, y_m, radius_m, top_m)


def _after(start_s: float | None, length_s: float | None) -> float | None:
    return None if start_s is None or length_s is None else start_s + length_s


def _flag(values: Mapping[str, Any], key: str, *, otherwise: bool) -> bool:
    value = values.get(key)
    return bool(value) if isinstance(value, (bool, np.bool_)) else otherwise


def _integer(values: Mapping[str, Any], key: str) -> int | None:
    value = number(values, key)
    return None if value is None else int(value)

"""The milestones of a flight, and its figures: reports, terminals, sweeps and pictures read them.

Milestones are in the terms of the paper: contact, unstable phase, recovery. A figure is one
record. docs/figures.md defines them.

Values of the paper: "Tombo Propeller: Bio-Inspired Deformable Structure toward
Collision-Accommodated Control for Drones", the flight experiment with Conf. 13 propellers. Its
frame is NED; points here are ENU: (x, y, z) = (east, north, up).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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
from tombo_flight.scenario import as_mapping, load_scenario

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
    obstacle: dict[str, float] | None
    """See `drawn_obstacle`."""

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


def drawn_obstacle(scenario: Mapping[str, Any]) -> dict[str, float] | None:
    """Return the obstacle of a scenario as flown; None: it has none.

    Returns:
        x_m, y_m, radius_m, top_m of a vertical cylinder that stands on the ground; map ENU.
    """
    values = scenario.get("obstacle") or {}
    if not values.get("radius_m") or not values.get("top_m"):
        return None
    return {key: float(values[key]) for key in ("x_m", "y_m", "radius_m", "top_m")}


def _after(start_s: float | None, length_s: float | None) -> float | None:
    return None if start_s is None or length_s is None else start_s + length_s


def _point(value: Any) -> Point | None:
    if value is None or None in value:
        return None
    return float(value[0]), float(value[1]), float(value[2])


PAPER_SCENARIOS: Final = ("paper_collision", "known_obstacle")
"""Scenarios of the paper's experiment; figures of others are not compared with it."""
Value = float | str | Point | None
"""A number or a point in the figure's unit, or words; None: there is none."""


@dataclass(frozen=True)
class Figure:
    """A figure of a flight."""

    key: str
    """Its key in the summary, where it is one of the summary's."""
    name: str
    unit: str
    digits: int
    paper: Value = None
    """Printed by the paper for its experiment with the reaction."""
    factor: float = 1.0
    """Factor from the summary's unit to `unit`."""
    derived: Callable[[FlightMilestones], Value] | None = None
    """Computes it where the summary does not have it."""
    card: bool = False
    """It is in the header of a report."""

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def of(self, summary: Mapping[str, Any], milestones: FlightMilestones) -> Value:
        """Return the figure of a flight."""
        if self.derived is not None:
            return self.derived(milestones)
        value = summary[self.key]
        return None if value is None else self.factor * float(value)

    def text(self, value: Value) -> str:
        """Return a value of the figure with its unit."""
        if isinstance(value, tuple):
            return f"({', '.join(fixed(v, self.digits) for v in value)}) {self.unit}"
        if isinstance(value, float):
            return f"{fixed(value, self.digits)} {self.unit}".rstrip()
        return value or "–"


def fixed(value: float, digits: int) -> str:
    """Return a number with some decimals and a typographic minus."""
    return f"{value:.{digits}f}".replace("-", "−")


def _recovery_phase(m: FlightMilestones) -> float | None:
    if m.unstable_end_s is None or m.recovery_end_s is None:
        return None
    return max(0.0, m.recovery_end_s - m.unstable_end_s) or None  # settled before its end


def _bounce(m: FlightMilestones) -> float | None:
    return None if m.x_c_m is None or m.x_r_m is None else math.dist(m.x_c_m, m.x_r_m)


FIGURES: Final = (
    Figure("outcome", "Outcome", "", 0, paper="recovers", derived=lambda m: m.verdict.value),
    Figure("collision_time_s", "Time of the collision", "s", 2, paper=23.0),
    Figure("unstable_phase_s", "Unstable phase", "s", 2, paper=1.5, card=True),
    Figure("recovery_phase_s", "Recovery phase", "s", 2, paper=3.5, derived=_recovery_phase),
    Figure("recovery_time_s", "Recovery time", "s", 2, paper=5.0, card=True),
    Figure("max_falling_distance_m", "Largest falling distance", "m", 2, paper=0.5, card=True),
    Figure("bounce_m", "Distance from x_c to x_r", "m", 3, paper=0.8, derived=_bounce),
    Figure("x_c_m", "x_c, point of collision", "m", 2, (1.7, 0.0, 2.0), derived=lambda m: m.x_c_m),
    Figure("x_r_m", "x_r, equilibrium point", "m", 2, (0.9, 0.2, 2.0), derived=lambda m: m.x_r_m),
    Figure("contact_known_s", "Detection latency", "ms", 0, factor=1e3, card=True),
    Figure("max_tilt_rad", "Largest tilt", "°", 1, factor=180.0 / math.pi, card=True),
    Figure("settled_error_m", "Settled error", "m", 3, card=True),
)
"""Figures of a report, in their order."""
MORE: Final = (
    Figure("hover_rms_m", "RMS error in hover", "m", 3),
    Figure("approach_rms_m", "RMS error in the approach", "m", 3),
    Figure("false_alarms", "False alarms", "", 0),
    Figure("strikes", "Strikes", "", 1),
)
"""Figures of terminals and sweeps alone."""
BY_KEY: Final = {figure.key: figure for figure in (*FIGURES, *MORE)}


def is_paper_flight(scenario: Mapping[str, Any]) -> bool:
    """Return whether a scenario, as flown, is the paper's experiment with its vehicle."""
    course = (scenario.get("mission") or {}).get("course")
    if scenario.get("name") not in PAPER_SCENARIOS or course:
        return False
    paper = as_mapping(load_scenario(str(scenario["name"])))
    conf = (scenario.get("propeller") or {}).get("conf", paper["propeller"]["conf"])
    same_vehicle = scenario.get("vehicle", paper["vehicle"]) == paper["vehicle"]
    return bool(same_vehicle and conf == paper["propeller"]["conf"])


def figures_of(
    flight: Flight, figures: Sequence[Figure] = FIGURES
) -> list[tuple[Figure, Value, Value]]:
    """Return figures of a flight, each with its value and the paper's.

    Only flights of the paper's experiment have values of the paper.
    """
    of_paper, milestones = is_paper_flight(flight.scenario), find_milestones(flight)
    rows: list[tuple[Figure, Value, Value]] = []
    for figure in figures:
        printed = figure.paper if of_paper else None
        if printed == "recovers" and flight.summary["reaction"] == NoReaction.name:
            printed = "falls and crashes"
        rows.append((figure, figure.of(flight.summary, milestones), printed))
    return rows

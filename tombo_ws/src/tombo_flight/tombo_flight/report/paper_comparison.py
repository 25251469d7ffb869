"""The paper's figures of the collision experiment beside those of a flight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from tombo_collision.reactions.none import NoReaction
from tombo_flight.report import paper_values as paper
from tombo_flight.report.milestones import FlightMilestones, number
from tombo_flight.scenario import as_mapping, load_scenario

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

PAPER_SCENARIOS: Final = ("paper_collision", "known_obstacle")
"""Those that are the paper's experiment; the figures of others are not held against it."""
_NONE: Final = "–"
_DEFINITIONS: Final = {
    "Outcome": "In the paper the vehicle recovers with the reaction; without it, it falls and "
    "crashes to the ground. Crashed: the frame touches the ground before landing is commanded, "
    "or the tilt passes 2.1 rad and does not come back. No contact is no success.",
    "Time of the collision": "First contact, on the clock that starts with the flight. The "
    "paper's value is read from its figure: about, and set by how long the vehicle hovers first.",
    "Unstable phase": "From contact until the tilt stays below 0.17 rad and the body rate below "
    "1 rad/s for 0.3 s.",
    "Recovery phase": "From the end of the unstable phase until the vehicle has settled at x_r; "
    "none where it settles before that end.",
    "Recovery time": "Both phases together: from contact until the position stays within 0.1 m "
    "of x_r and the speed below 0.1 m/s for 1 s. The paper's value is a mean over its trials.",
    "Largest falling distance": "Height at contact minus the lowest height until settled. The "
    "paper's value is a mean over its trials.",
    "Falling rate": "Mean rate of descent from contact to the lowest point. The paper prints the "
    "rate that was observed, without the stretch it belongs to.",
    "Distance from x_c to x_r": "The paper asks for d_r = 0.8 m, but the points it prints are "
    f"{paper.PRINTED_BOUNCE_M:.3f} m apart: x_r was chosen by hand there. Here "
    "x_r = x_c + d_r n_r with a unit n_r.",
    "x_c, point of collision": "Position of the vehicle's centre at contact as the detector "
    "estimates it; if nothing was detected, the true one. East, north, up; the paper prints it "
    "in north-east-down as [0, 1.7, −2.0].",
    "x_r, equilibrium point": "Where the vehicle is sent after the collision. East, north, up; "
    "the paper prints it in north-east-down as [0.2, 0.9, −2.0].",
    "Detection latency": "From the true contact until the reaction knows of it, by the poses of "
    "the motion capture or, where it uses them, by gyro and accelerometer. Negative when the "
    "vehicle enters a known region before it touches. Not printed in the paper.",
    "Largest tilt": "Largest angle between the vehicle's up axis and the vertical. Not printed "
    "in the paper.",
    "Settled error": "Distance from x_r once settled. Not printed in the paper.",
}


@dataclass(frozen=True)
class FigureRow:
    """One figure: what the paper prints and what this flight did; None where there is none.

    `paper_text` and `flight_text` stand for figures that are not one number.
    """

    name: str
    unit: str
    paper: float | None
    flight: float | None
    digits: int = 2
    paper_text: str | None = None
    flight_text: str | None = None

    @property
    def has_figure(self) -> bool:
        """Whether this flight has the figure."""
        return self.flight is not None or self.flight_text not in (None, _NONE)

    @property
    def definition(self) -> str:
        """What the figure means, and where it differs from the paper's."""
        return _DEFINITIONS[self.name]


def is_paper_flight(scenario: Mapping[str, Any]) -> bool:
    """Return whether a scenario, as flown, is the paper's experiment with its vehicle."""
    course = (scenario.get("mission") or {}).get("course")
    if scenario.get("name") not in PAPER_SCENARIOS or course:
        return False
    paper = as_mapping(load_scenario(str(scenario["name"])))
    conf = (scenario.get("propeller") or {}).get("conf", paper["propeller"]["conf"])
    same_vehicle = scenario.get("vehicle", paper["vehicle"]) == paper["vehicle"]
    return bool(same_vehicle and conf == paper["propeller"]["conf"])


def comparison_rows(milestones: FlightMilestones, flight: Flight) -> list[FigureRow]:
    """Return the rows of the table, in its order; the paper's figures for its experiment alone."""
    rows = _rows(milestones, flight.summary)
    if is_paper_flight(flight.scenario):
        return rows
    return [replace(row, paper=None, paper_text=row.paper_text and _NONE) for row in rows]


def _rows(milestones: FlightMilestones, summary: Mapping[str, Any]) -> list[FigureRow]:
    known_s = number(summary, "contact_known_s")
    latency_s = number(summary, "detection_latency_s") if known_s is None else known_s
    tilt_rad = number(summary, "max_tilt_rad")
    falling_distance_m, settled_m = (
        number(summary, k) for k in ("max_falling_distance_m", "settled_error_m")
    )
    expected = "falls and crashes" if milestones.reaction == NoReaction.name else "recovers"
    x_c, x_r = milestones.x_c_m, milestones.x_r_m
    bounce_m = None if x_c is None or x_r is None else math.dist(x_c, x_r)
    latency_ms = None if latency_s is None else 1e3 * latency_s
    tilt_deg = None if tilt_rad is None else math.degrees(tilt_rad)
    return [
        _words("Outcome", expected, milestones.verdict.value),
        FigureRow("Time of the collision", "s", paper.COLLISION_TIME_S, milestones.contact_s),
        FigureRow("Unstable phase", "s", paper.UNSTABLE_PHASE_S, milestones.unstable_phase_s),
        FigureRow("Recovery phase", "s", paper.RECOVERY_PHASE_S, milestones.recovery_phase_s),
        FigureRow("Recovery time", "s", paper.MEAN_RECOVERY_TIME_S, milestones.recovery_time_s),
        FigureRow(
            "Largest falling distance", "m", paper.MEAN_MAX_FALLING_DISTANCE_M, falling_distance_m
        ),
        FigureRow(
            "Falling rate", "m/s", paper.OBSERVED_FALLING_RATE_M_S, milestones.falling_rate_m_s
        ),
        FigureRow("Distance from x_c to x_r", "m", paper.BOUNCE_DISTANCE_M, bounce_m, 3),
        _words("x_c, point of collision", _place(paper.COLLISION_POINT_M), _place(x_c)),
        _words("x_r, equilibrium point", _place(paper.EQUILIBRIUM_POINT_M), _place(x_r)),
        FigureRow("Detection latency", "ms", None, latency_ms, 0),
        FigureRow("Largest tilt", "°", None, tilt_deg, 1),
        FigureRow("Settled error", "m", None, settled_m, 3),
    ]


def fixed(value: float, digits: int) -> str:
    """The number with so many decimals and a typographic minus."""
    return f"{value:.{digits}f}".replace("-", "−")


def _words(name: str, paper_text: str, flight_text: str) -> FigureRow:
    return FigureRow(name, "", None, None, paper_text=paper_text, flight_text=flight_text)


def _place(value: tuple[float, float, float] | None) -> str:
    return _NONE if value is None else "(" + ", ".join(fixed(v, 2) for v in value) + ") m"

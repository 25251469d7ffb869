"""The figures of a flight, in one list: its report, the paper's table and sweeps read it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from tombo_collision.reactions.none import NoReaction
from tombo_flight.report import paper_values as paper
from tombo_flight.report.milestones import FlightMilestones, number
from tombo_flight.scenario import as_mapping, load_scenario

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

PAPER_SCENARIOS: Final = ("paper_collision", "known_obstacle")
"""Those that are the paper's experiment; the figures of others are not held against it."""
Value = float | str | tuple[float, float, float] | None
"""A number or a point in the figure's unit, or words; None: there is none."""


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
class Figure:
    """A figure of a flight: a key of its summary, or what follows from its milestones."""

    name: str
    unit: str
    digits: int
    source: str | Callable[[FlightMilestones], Value]
    """Its key in the summary, or a function of the milestones."""
    paper: Value = None
    """What the paper prints for its experiment with the reaction."""
    factor: float = 1.0
    """From the summary's unit to `unit`."""

    @property
    def definition(self) -> str:
        """What it means, and where that differs from the paper's."""
        return _DEFINITIONS[self.name]

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def of(self, summary: Mapping[str, Any], milestones: FlightMilestones) -> Value:
        """Return the figure of a flight."""
        if not isinstance(self.source, str):
            return self.source(milestones)
        value = number(summary, self.source)
        return None if value is None else self.factor * value

    def text(self, value: Value) -> str:
        """Return a value of the figure with its unit."""
        if isinstance(value, tuple):
            return f"({', '.join(fixed(v, self.digits) for v in value)}) {self.unit}"
        if isinstance(value, float):
            return f"{fixed(value, self.digits)} {self.unit}".rstrip()
        return value or "–"


def fixed(value: float, digits: int) -> str:
    """Return a number with so many decimals and a typographic minus."""
    return f"{value:.{digits}f}".replace("-", "−")


FIGURES: Final = (
    Figure("Outcome", "", 0, lambda m: m.verdict.value, "recovers"),
    Figure("Time of the collision", "s", 2, "collision_time_s", paper.COLLISION_TIME_S),
    Figure("Unstable phase", "s", 2, "unstable_phase_s", paper.UNSTABLE_PHASE_S),
    Figure("Recovery phase", "s", 2, lambda m: m.recovery_phase_s, paper.RECOVERY_PHASE_S),
    Figure("Recovery time", "s", 2, "recovery_time_s", paper.MEAN_RECOVERY_TIME_S),
    Figure(
        "Largest falling distance",
        "m",
        2,
        "max_falling_distance_m",
        paper.MEAN_MAX_FALLING_DISTANCE_M,
    ),
    Figure(
        "Falling rate", "m/s", 2, lambda m: m.falling_rate_m_s, paper.OBSERVED_FALLING_RATE_M_S
    ),
    Figure("Distance from x_c to x_r", "m", 3, lambda m: m.bounce_m, paper.BOUNCE_DISTANCE_M),
    Figure("x_c, point of collision", "m", 2, lambda m: m.x_c_m, paper.COLLISION_POINT_M),
    Figure("x_r, equilibrium point", "m", 2, lambda m: m.x_r_m, paper.EQUILIBRIUM_POINT_M),
    Figure("Detection latency", "ms", 0, "contact_known_s", factor=1e3),
    Figure("Largest tilt", "°", 1, "max_tilt_rad", factor=180.0 / math.pi),
    Figure("Settled error", "m", 3, "settled_error_m"),
)
"""Those of a report, in their order."""
MORE: Final = (
    Figure("RMS error in hover", "m", 3, "hover_rms_m"),
    Figure("RMS error in the approach", "m", 3, "approach_rms_m"),
    Figure("False alarms", "", 0, "false_alarms"),
    Figure("Strikes", "", 1, "strikes"),
)
"""Those of terminals and sweeps alone."""
BY_KEY: Final = {f.source: f for f in (*FIGURES, *MORE) if isinstance(f.source, str)}
"""Key of the summary → its figure."""
CARDS: Final = (
    *("unstable_phase_s", "recovery_time_s", "max_falling_distance_m", "contact_known_s"),
    *("max_tilt_rad", "settled_error_m"),
)
"""Key figures in the header of a report."""


@dataclass(frozen=True)
class FigureRow:
    """A figure of one flight, and what the paper prints."""

    figure: Figure
    flight: Value
    paper: Value = None


def is_paper_flight(scenario: Mapping[str, Any]) -> bool:
    """Return whether a scenario, as flown, is the paper's experiment with its vehicle."""
    course = (scenario.get("mission") or {}).get("course")
    if scenario.get("name") not in PAPER_SCENARIOS or course:
        return False
    paper = as_mapping(load_scenario(str(scenario["name"])))
    conf = (scenario.get("propeller") or {}).get("conf", paper["propeller"]["conf"])
    same_vehicle = scenario.get("vehicle", paper["vehicle"]) == paper["vehicle"]
    return bool(same_vehicle and conf == paper["propeller"]["conf"])


def figure_rows(
    flight: Flight, milestones: FlightMilestones, figures: Sequence[Figure] = FIGURES
) -> list[FigureRow]:
    """Return figures of a flight; the paper's beside those of its experiment alone."""
    of_paper = is_paper_flight(flight.scenario)
    rows = []
    for figure in figures:
        printed = figure.paper if of_paper else None
        if printed == "recovers" and milestones.reaction == NoReaction.name:
            printed = "falls and crashes"
        rows.append(FigureRow(figure, figure.of(flight.summary, milestones), printed))
    return rows

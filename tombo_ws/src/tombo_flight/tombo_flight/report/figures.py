"""The figures of a flight, one record each: reports, terminals, sweeps and pictures read them.

docs/figures.md defines them.

Values of the paper: "Tombo Propeller: Bio-Inspired Deformable Structure toward
Collision-Accommodated Control for Drones", the flight experiment with Conf. 13 propellers. Its
frame is NED; points here are ENU: (x, y, z) = (east, north, up).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from tombo_collision.reactions.none import NoReaction
from tombo_flight.report.milestones import FlightMilestones, find_milestones
from tombo_flight.scenario import as_mapping, load_scenario

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

PAPER_SCENARIOS: Final = ("paper_collision", "known_obstacle")
"""Those that are the paper's experiment; the figures of others are not held against it."""
Value = float | str | tuple[float, float, float] | None
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
    """From the summary's unit to `unit`."""
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
"""Those of a report, in their order."""
MORE: Final = (
    Figure("hover_rms_m", "RMS error in hover", "m", 3),
    Figure("approach_rms_m", "RMS error in the approach", "m", 3),
    Figure("false_alarms", "False alarms", "", 0),
    Figure("strikes", "Strikes", "", 1),
)
"""Those of terminals and sweeps alone."""
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

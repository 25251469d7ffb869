"""Several vehicles in one room: their names, their places, and what each flies."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tombo_control.planning.mission import MissionParams
from tombo_dynamics.effects.downwash import MOST_OTHERS
from tombo_dynamics.errors import InputError
from tombo_flight.scenario import Scenario

MOST_VEHICLES = MOST_OTHERS + 1
_SPACING = 2.0
"""Distance between two starts [m], along map y."""


@dataclass(frozen=True)
class FlownVehicle:
    """One of several vehicles."""

    name: str
    """Its namespace, without a slash: v1, v2."""
    scenario: Scenario
    start: tuple[float, float]
    """Map x and y [m]."""
    seed: int


def vehicle_names(count: int) -> list[str]:
    """Return the names of `count` vehicles."""
    return [f"v{number}" for number in range(1, count + 1)]


def vehicles_of(scenario: Scenario, count: int, seed: int) -> list[FlownVehicle]:
    """Return vehicles that fly a scenario side by side: the first one the scenario as it is.

    Downwash of the others acts on each, unless the scenario sets another strength.
    """
    effects = {"downwash": {"strength": 1.0}, **scenario.effects}
    vehicles = []
    for k, name in enumerate(vehicle_names(count)):
        mission = _moved(scenario.mission, k * _SPACING)
        flown = replace(scenario, mission=mission, effects=effects)
        vehicles.append(FlownVehicle(name, flown, (0.0, k * _SPACING), seed + k))
    return vehicles


def _moved(mission: MissionParams, north: float) -> MissionParams:
    """Return the same plan further along map y [m].

    Raises:
        InputError: the course is a file, of one vehicle.
    """
    if isinstance(mission.course, str):
        raise InputError("mission.course: a file; accepted with several vehicles: waypoints")
    course = mission.course and tuple(
        waypoint if waypoint.y is None else replace(waypoint, y=waypoint.y + north)
        for waypoint in mission.course
    )
    return replace(mission, goal_y=mission.goal_y + north, course=course)

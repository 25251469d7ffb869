"""Manoeuvres that distinguish causes, as missions that `tombo fly` flies.

Each mission takes at most 40 s and stays within 4 m x 4 m x 3 m about the place of take-off.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

Waypoints = list[dict[str, float]]

_QUARTER = 1.5708


@dataclass(frozen=True)
class Manoeuvre:
    """A flight that excites certain effects."""

    name: str
    text: str
    """How it is done with a real vehicle, a sentence or two."""
    scenario: Mapping[str, Any]
    """A scenario of plain values, as in a file."""


def manoeuvre_catalogue() -> dict[str, Manoeuvre]:
    """Return all manoeuvres by name."""
    return {
        name: Manoeuvre(name, text, mission(name, text, course))
        for name, text, course in _courses()
    }


def mission(name: str, text: str, course: Waypoints) -> dict[str, Any]:
    """Return the scenario of a course: no obstacle, no reaction, and landing at its end."""
    return {
        "extends": "no_obstacle",
        "description": f"{name.replace('_', ' ').capitalize()}: {text}",
        "reaction": {"name": "none"},
        "control": {"velocity_max_xy": 3.0, "velocity_max_z": 1.8},
        "mission": {
            "takeoff_time": 0.5,
            "height": 1.2,
            "climb_speed": 0.9,
            "approach_time": 3.6,
            "land_time": 55.0,
            "land_speed": 0.5,
            "course": course,
        },
    }


def _courses() -> Iterable[tuple[str, str, Waypoints]]:
    """Return name, text and course of what can be flown."""
    yield (
        "turn_in_hover",
        "hover for two seconds each, heading by a quarter turn further, twice round.",
        [{"yaw": 0.0, "yaw_rate": 1.4, "hold": 2.0}]
        + [{"yaw": round(i * _QUARTER, 4)} for i in range(1, 9)],
    )
    yield (
        "both_ways",
        "fly the same leg there and back at one speed, along both axes, heading the same.",
        [
            {"x": -1.4, "speed": 1.4, "acceleration": 2.5, "hold": 0.3},
            *_shuttle("x", (1.4, -1.4, 1.4, -1.4, 0.0)),
            *_shuttle("y", (-1.4, 1.4, -1.4, 1.4, 0.0)),
        ],
    )
    yield (
        "three_speeds",
        "fly the same leg there and back at 0.7, 1.4 and 2.4 m/s.",
        [
            {"x": -1.6, "speed": 1.4, "acceleration": 3.0, "hold": 0.2},
            *({"x": x, "speed": v} for v in (2.4, 1.4, 0.7, 2.4) for x in (1.6, -1.6)),
        ],
    )
    yield (
        "two_heights",
        "hover low and high in turn, four seconds each, so that the voltage is nearly the same.",
        [{"z": z, "speed": 1.2, "acceleration": 1.5, "hold": 4.0} for z in (0.35, 2.2) * 2],
    )
    yield (
        "yaw_steps",
        "in hover, turn by a quarter to either side as quickly as the vehicle can.",
        [
            {"yaw": yaw, "yaw_rate": 5.0, "hold": 1.2}
            for yaw in (_QUARTER, 0.0, -_QUARTER, 0.0) * 3
        ],
    )
    yield (
        "rate_steps",
        "short quick legs ahead and sideways, so that the vehicle tilts as fast as it can.",
        [
            {"x": -0.3, "speed": 2.4, "acceleration": 5.0},
            *_shuttle("x", (0.3, -0.3) * 4 + (0.0,)),
            *_shuttle("y", (0.3, -0.3) * 4 + (0.0,)),
            *_shuttle("x", (0.6, -0.6) * 2 + (0.0,)),
            *_shuttle("y", (0.6, -0.6) * 2 + (0.0,)),
        ],
    )
    yield (
        "slow_to_quick",
        "rock ahead and sideways, slowly first, then quicker and quicker.",
        [
            {axis: place, "speed": 2.4, "acceleration": acceleration}
            for acceleration in (0.8, 1.5, 3.0, 4.0)
            for axis in ("x", "y")
            for place in (0.5, -0.5, 0.0)
        ],
    )
    yield (
        "square",
        "fly a square of 2 m, heading the same; then once more after a quarter turn.",
        [
            {"x": -1.0, "y": -1.0, "speed": 1.4, "acceleration": 2.5, "hold": 0.2},
            *_round(),
            {"yaw": _QUARTER, "yaw_rate": 1.4},
            *_round(),
        ],
    )
    yield ("long_hover", "hover in one place for 28 s.", [{"yaw": 0.0, "hold": 28.0}])
    yield (
        "climb_and_descend",
        "climb and descend between 0.6 and 2.4 m, slowly and then briskly.",
        [
            {"z": z, "speed": speed, "acceleration": acceleration, "hold": 0.3}
            for speed, acceleration in ((0.8, 1.5), (1.6, 4.0), (1.6, 4.0))
            for z in (2.4, 0.6, 2.4, 0.6)
        ],
    )


def _shuttle(axis: str, places: Iterable[float]) -> Waypoints:
    return [{axis: place} for place in places]


def _round() -> Waypoints:
    return [{"x": 1.0}, {"y": 1.0}, {"x": -1.0}, {"y": -1.0}]

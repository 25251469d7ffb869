"""Limits of the flight and time limits of the states in `state_machine`."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.params import param

LEAST_TILT_MAX = 0.2
"""[rad]: smaller tilts are always within the limits, at any `tilt_max`."""


@dataclass(frozen=True)
class SafetyParams:
    """When the controller leaves the set points, and when the rotors stop."""

    hold_time: float = param(
        10.0,
        "s",
        (0.0, 600.0),
        "without set points it holds for so long, then lands",
        "a node is restarted in 5 s",
    )
    return_time: float = param(
        5.0,
        "s",
        (0.0, 60.0),
        "a position that comes back later than this is used to land, not to fly on",
        "the time of the descent from 2 m",
    )
    blind_time: float = param(
        10.0,
        "s",
        (1.0, 60.0),
        "the rotors stop so long after the time in which a descent at half its speed would end",
        "estimated, because: touchdown is seen 1 to 2 s after contact",
    )
    takeoff_distance: float = param(
        1.0,
        "m",
        (0.1, 100.0),
        "no take-off from further than this from where the vehicle was last known",
        "estimated, because: a vehicle that is moved by hand is seen all the way",
    )
    takeoff_tilt: float = param(
        0.26, "rad", (0.02, 1.0), "no take-off from a larger tilt", "15 deg: legs off the ground"
    )
    touchdown_push: float = param(
        0.35,
        "1",
        (0.1, 0.9),
        "touchdown: the ground carries this share of the weight",
        "docs/safety.md: the largest in flight",
    )
    touchdown_time: float = param(
        0.3, "s", (0.05, 5.0), "and has done so for this time", "three bounces of the landing gear"
    )
    setpoint_distance: float = param(
        8.0,
        "m",
        (0.5, 1e3),
        "a set point further from the vehicle than this is refused",
        "4 s at control.velocity_max_xy",
    )
    separation: float = param(
        0.8,
        "m",
        (0.1, 100.0),
        "the mission refuses a set point nearer than this to another vehicle, and holds",
        "estimated, because: two vehicles of 0.35 m radius, and 0.1 m of error",
    )
    speed_max: float = param(
        15.0, "m/s", (0.5, 50.0), "a faster vehicle lands at once", "the fastest a course may be"
    )
    tilt_max: float = param(
        1.4,
        "rad",
        (LEAST_TILT_MAX, 3.2),
        "a vehicle tilted further than this for limit_time lands",
        "80 deg; control.tilt_max is asked for at most",
    )
    limit_time: float = param(
        0.5,
        "s",
        (0.0, 10.0),
        "a limit of speed, tilt or place is broken after so long",
        "a strike tilts the vehicle for 0.3 s",
    )


@dataclass(frozen=True)
class FlightVolume:
    """Where the vehicle may fly: a box, and a cylinder if it has a radius. All in map.

    Set points outside are moved to its border; a vehicle further outside than the margin lands.
    """

    x_min: float = param(-1e3, "m", (-1e3, 1e3), "lowest x")
    x_max: float = param(1e3, "m", (-1e3, 1e3), "highest x")
    y_min: float = param(-1e3, "m", (-1e3, 1e3), "lowest y")
    y_max: float = param(1e3, "m", (-1e3, 1e3), "highest y")
    z_max: float = param(100.0, "m", (0.3, 1e3), "greatest height")
    radius: float = param(0.0, "m", (0.0, 1e3), "of the cylinder; 0: there is none")
    centre_x: float = param(0.0, "m", (-1e3, 1e3), "axis of the cylinder, x")
    centre_y: float = param(0.0, "m", (-1e3, 1e3), "axis of the cylinder, y")
    margin: float = param(
        0.5, "m", (0.0, 20.0), "what the vehicle may be outside", "overshoot of a leg at 2 m/s"
    )

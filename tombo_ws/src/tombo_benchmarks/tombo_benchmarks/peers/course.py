"""The course and the vehicle that both simulators fly, as plain numbers.

A Crazyflie 2.1 starts in hover, flies three legs of a triangle and holds: thrust and torque with
the square of the rotors' speed, a lag of first order, drag linear in the velocity, gravity.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Final

import numpy as np

from tombo_control.planning.leg import Leg, straight_leg
from tombo_control.planning.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.arrays import Array
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import ARM_X, GRAVITY
from tombo_flight.scenario import Scenario, load_scenario

SECONDS: Final = 12.0
SET_POINT_TICKS: Final = 20
"""Ticks between two set points: every position loop runs at 50 Hz."""
CORNERS: Final = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.2), (1.0, 1.0, 1.0), (0.0, 0.0, 1.0))
_SPEED: Final = 0.6
_PAUSE_S: Final = 0.2
_DRAG: Final = 0.0075
"""N s/m in the disc plane, estimated, because: 0.28 1/s of mass, as small quadrotors show."""
_NULL: Final = (
    "vehicle.rotor_height=0.0",
    "effects.linear_rotor_drag.d_z=0",
    "effects.ground_effect.strength=0",
    "effects.gusts.deviation=0",
    "effects.thrust_scatter.deviation=0",
)
"""What crazyflow does not have."""
_SPREAD_M: Final = 0.05


def course_scenario() -> Scenario:
    """Return the vehicle with the physics that all simulators have, other effects at null."""
    settings = [*_NULL, f"effects.linear_rotor_drag.d_xy={_DRAG}"]
    return load_scenario("hover", settings, vehicle="crazyflie_2_1")


def course_legs() -> list[tuple[Leg, int, int]]:
    """Return the legs with the first tick of each and the tick after its last."""
    legs: list[tuple[Leg, int, int]] = []
    first = 0
    for start, goal in pairwise(CORNERS):
        leg = straight_leg(start, goal, _SPEED, first * TICK_S)
        steps = math.ceil((leg.end_s + _PAUSE_S) / TICK_S / SET_POINT_TICKS)
        last = steps * SET_POINT_TICKS
        legs.append((leg, first, last))
        first = last
    leg, first, _ = legs[-1]
    legs[-1] = (leg, first, round(SECONDS / TICK_S))
    return legs


def set_points() -> Array:
    """Return position, velocity and acceleration (K, 9) that are asked for, every 20 ms, map."""
    rows = []
    for leg, first, last in course_legs():
        for tick in range(first, last, SET_POINT_TICKS):
            profile = trapezoidal_profile(
                tick * TICK_S - leg.begin_s, leg.end_s - leg.begin_s, leg.ramp_s
            )
            start, cruise = np.array(leg.start), np.array(leg.velocity)
            way, speed, change = profile
            rows.append(np.concatenate([start + way * cruise, speed * cruise, change * cruise]))
    return np.array(rows)


def starts(count: int) -> Array:
    """Return where N vehicles hover at first (N, 3), map [m]: the first on the course."""
    shifts = np.random.default_rng(0).uniform(-_SPREAD_M, _SPREAD_M, (count, 3))
    shifts[0] = 0.0
    return np.asarray(np.array(CORNERS[0]) + shifts)


def hover_speed(scenario: Scenario) -> float:
    """Return the speed of each rotor in hover [rad/s]."""
    return math.sqrt(scenario.vehicle.hover_thrust() / float(scenario.propeller.k_thrust))


def order(scenario: Scenario) -> dict[str, Any]:
    """Return what crazyflow's process reads: SI units, map ENU, body FLU, rotors as PX4 counts."""
    vehicle, propeller = scenario.vehicle, scenario.propeller
    return {
        "mass": vehicle.mass,
        "inertia": [vehicle.inertia_xx, vehicle.inertia_yy, vehicle.inertia_zz],
        "arm": float(abs(vehicle.arm_length * ARM_X[0])),
        "k_thrust": propeller.k_thrust,
        "k_torque": propeller.k_torque,
        "rotor_inertia": vehicle.rotor_inertia,
        "motor_time_constant": vehicle.motor_time_constant,
        "drag": [_DRAG, _DRAG, 0.0],
        "gravity": GRAVITY,
        "hover_speed": hover_speed(scenario),
        "step_s": TICK_S,
        "set_point_ticks": SET_POINT_TICKS,
        "set_points": set_points().tolist(),
    }

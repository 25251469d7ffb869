"""A Crazyflie over one course here, and the order for crazyflow to fly the same.

It starts in hover, flies three legs of a triangle and holds: thrust and torque with the square of
the rotors' speed, a lag of first order, drag linear in the velocity, gravity.
"""

from __future__ import annotations

import math
import os
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy as np

from tombo_benchmarks.speed.kernel_flight import KernelFlight, fly_vehicles, new_flight
from tombo_control.planning.leg import Leg, store_leg, straight_leg
from tombo_control.planning.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase
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


_BLOCK = 16
"""Vehicles that a thread takes at a time: their memory fits the cache."""


def hovering_flight(scenario: Scenario) -> KernelFlight:
    """Return the vehicle in hover at the course's begin."""
    flight = new_flight(scenario, 0)
    place = starts(1)[0]
    flight.plant.state.position = flight.autopilot.state.position = place
    flight.autopilot.setpoint.position = place
    speed = hover_speed(scenario)
    flight.plant.rotor_speed = flight.plant.rotor_command = speed
    flight.autopilot.mode_asked = Phase.APPROACH
    return flight


class OurVehicles:
    """N vehicles that fly the first ticks of the course."""

    def __init__(self, count: int, ticks: int) -> None:
        self.count, self.ticks = count, ticks
        self._flight = flight = hovering_flight(course_scenario())
        self._plants = np.repeat(flight.plant.as_array(), count)
        self._autopilots = np.repeat(flight.autopilot.as_array(), count)
        self._first = (flight.plant.copy(), flight.autopilot.copy())
        self._pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)))

    def fly(self) -> float:
        """Fly all from their starts; return steps in a second of a processor core."""
        self._plants[:], self._autopilots[:] = self._first
        places = starts(self.count)
        self._plants["state"]["position"] = self._autopilots["state"]["position"] = places
        began_s = time.process_time()
        for leg, start, last in course_legs():
            stop = min(last, self.ticks)
            if start < stop:
                store_leg(self._flight.autopilot.leg, leg)
                self._autopilots["leg"] = self._flight.autopilot["leg"]
                fly_block = partial(self._fly_block, start=start, stop=stop)
                list(self._pool.map(fly_block, range(0, self.count, _BLOCK)))
        return self.count * self.ticks / (time.process_time() - began_s)

    def _fly_block(self, first: int, start: int, stop: int) -> None:
        flight, last = self._flight, min(first + _BLOCK, self.count)
        fly_vehicles(
            self._plants, self._autopilots, flight.maps, flight.theta, flight.zero_noise,
            first, last, start, stop,
        )  # fmt: skip

    @property
    def position(self) -> Array:
        """(N, 3) where they are, map [m]."""
        place: Array = self._plants["state"]["position"]
        return place.copy()

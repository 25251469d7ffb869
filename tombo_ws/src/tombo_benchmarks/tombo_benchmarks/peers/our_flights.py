"""The course flown here, by physics and cascade with the true state."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from tombo_benchmarks.peers.course import course_legs, course_scenario, hover_speed, starts
from tombo_benchmarks.speed.kernel_flight import (
    KernelFlight,
    fly_vehicles,
    fly_with_true_state,
    new_flight,
)
from tombo_control.planning.leg import store_leg
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase
from tombo_flight.scenario import Scenario

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


def flown_course() -> tuple[Array, Array]:
    """Return one vehicle's rotor commands that act in each tick (T, 4), and positions (T, 3)."""
    flight = hovering_flight(course_scenario())
    commands, positions = [], []
    for leg, start, stop in course_legs():
        store_leg(flight.autopilot.leg, leg)
        for tick in range(start, stop):
            commands.append(np.array(flight.plant.rotor_command))
            fly_with_true_state(
                flight.plant, flight.autopilot, flight.maps, flight.theta, flight.zero_noise,
                tick, tick + 1,
            )  # fmt: skip
            positions.append(np.array(flight.plant.state.position))
    return np.array(commands), np.array(positions)

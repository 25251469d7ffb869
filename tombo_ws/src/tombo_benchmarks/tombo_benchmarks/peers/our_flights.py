"""The course flown here: one vehicle, batches, and whole flights with sensors and all cores."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tombo_benchmarks.peers.course import course_legs, course_scenario, hover_speed, starts
from tombo_benchmarks.speed.kernel_flight import (
    KernelFlight,
    fly_vehicles,
    fly_with_true_state,
    new_flight,
)
from tombo_collision.reactions.policy import Policy
from tombo_control.planning.leg import store_leg
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.scenario import Scenario, load_scenario
from tombo_flight.training import Episodes

_BLOCK = 16
"""Vehicles that a thread takes at a time: their memory fits the cache."""
_WHOLE = (
    "reaction.name=reflex", "mission.takeoff_time=0.2", "mission.height=1.0",
    "mission.climb_speed=1.0", "mission.approach_time=2.2", "mission.goal_x=2.0",
    "obstacle.x=1.0166", "duration=20.0",
)  # fmt: skip
"""The paper's flight, its obstacle so near that it is met after some 3.5 s."""


@dataclass(frozen=True)
class Reading:
    """Steps of vehicles, and the time that they took."""

    steps: int
    wall_s: float
    processor_s: float
    """Of all threads."""

    @property
    def per_processor_s(self) -> float:
        """Steps in a second of a processor core."""
        return self.steps / self.processor_s

    @property
    def per_wall_s(self) -> float:
        """Steps in a second of wall time."""
        return self.steps / self.wall_s


def measured(fly: Callable[[], int]) -> Reading:
    """Return steps, wall time and processor time of all threads of a call."""
    wall, processor = time.perf_counter(), time.process_time()
    steps = fly()
    return Reading(steps, time.perf_counter() - wall, time.process_time() - processor)


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
    """N vehicles of the course, flown by physics and cascade with the true state."""

    def __init__(self, count: int, ticks: int) -> None:
        self.count, self.ticks = count, ticks
        self._flight = flight = hovering_flight(course_scenario())
        self._plants = np.repeat(flight.plant.as_array(), count)
        self._autopilots = np.repeat(flight.autopilot.as_array(), count)
        self._first = (flight.plant.copy(), flight.autopilot.copy())
        self._pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)))

    def fly(self) -> Reading:
        """Fly all from their starts."""
        plants, autopilots = self._plants, self._autopilots
        plants[:], autopilots[:] = self._first
        plants["state"]["position"] = autopilots["state"]["position"] = starts(self.count)
        return measured(self._fly)

    def _fly(self) -> int:
        firsts = range(0, self.count, _BLOCK)
        for leg, start, last in course_legs():
            stop = min(last, self.ticks)
            if start < stop:
                store_leg(self._flight.autopilot.leg, leg)
                self._autopilots["leg"] = self._flight.autopilot["leg"]
                fly_block = partial(self._fly_block, start=start, stop=stop)
                list(self._pool.map(fly_block, firsts))
        return self.count * self.ticks

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


class OurWholeFlights:
    """Whole flights up to the collision: sensors, estimator, cascade, mission, detector."""

    def __init__(self, count: int) -> None:
        self.count = count
        scenario = load_scenario("paper_collision", list(_WHOLE))
        steered = replace(scenario, reaction=Policy(**vars(scenario.reaction)))
        self._episodes = Episodes(steered, count, len(os.sched_getaffinity(0)))

    def fly(self) -> Reading:
        """Fly all from the ground until each has met the obstacle."""
        rngs = [np.random.default_rng(seed) for seed in range(self.count)]
        return measured(lambda: self._fly(rngs))

    def _fly(self, rngs: Any) -> int:
        self._episodes.reset(range(self.count), rngs, list(range(self.count)))
        ticks = self._episodes.batch.flights.progress["tick"]
        return int(ticks.sum())


class OurFlight:
    """One whole flight with its log, figures and events, as `tombo fly --no-record`."""

    def __init__(self) -> None:
        self._scenario = load_scenario("no_obstacle", [*_WHOLE[1:-2], "mission.land_time=8.0"])
        self._workspace = Workspace()

    def fly(self) -> Reading:
        """Fly it."""
        return measured(self._fly)

    def _fly(self) -> int:
        return len(fly_scenario(self._scenario, 0, self._workspace).t)

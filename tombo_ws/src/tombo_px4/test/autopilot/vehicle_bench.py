"""One flight of the vehicle behind its autopilot: its commands and its view, in ticks."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.records import numbers
from tombo_flight.scenario import load_scenario, world_of
from tombo_px4.autopilot.ekf2_model import Ekf2Model
from tombo_px4.autopilot.parameters import FLOWN_BY_POSES, ParameterTable
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.modes import OFFBOARD, Result

NAN = math.nan
GROUND = 0.185
"""Below this height [m] the vehicle stands."""
VISION = FLOWN_BY_POSES | {"COM_OBL_RC_ACT": 0}
Mangle = Callable[[Array, Array], tuple[Array, Array]]


def table_with(**values: float) -> ParameterTable:
    """The autopilot's parameters, some of them changed."""
    table = ParameterTable()
    for name, value in values.items():
        table.store(name, value)
    return table


def motion(
    position: Any = None, velocity: Any = None, push: Any = None, **rest: Any
) -> OffboardSetpoint:
    """A target of positions, velocities, accelerations; NaN: not commanded."""
    given = {"position": position, "velocity": velocity, "acceleration": push}
    axes = {name: np.array(v, float) for name, v in given.items() if v is not None}
    return OffboardSetpoint(**axes, **rest)


class Flight:
    """A vehicle, a stream of set points to it, and the motion capture that is sent to it."""

    def __init__(self, seed: int = 1, vision: bool = False, **values: float) -> None:
        table = table_with(**{**(VISION if vision else {}), **values})
        self.vehicle = Px4Vehicle(world_of(load_scenario("no_obstacle", [])), seed, table)
        self.target: OffboardSetpoint | None = None
        self.period = 50
        """Ticks between two set points."""
        self.see = vision
        self.mangle: Mangle | None = None
        """Error of the frame of the vision."""
        self.texts: list[str] = []

    @property
    def body(self) -> Array:
        """Position, velocity, attitude, rates (13), true."""
        return numbers(self.vehicle.simulator.plant.state)

    @property
    def rotors(self) -> Array:
        """True rotor speeds (4) [rad/s]."""
        return self.vehicle.simulator.plant.rotor_speed

    @property
    def ekf2(self) -> Ekf2Model:
        """The estimator."""
        return self.vehicle.ekf2_model

    @property
    def height(self) -> float:
        """True height above home [m]."""
        return float(self.body[2] - self.vehicle.home[2])

    def step(self) -> None:
        vehicle = self.vehicle
        if self.see:
            self._send_vision()
        if self.target is not None and vehicle.tick % self.period == 0:
            vehicle.target(self.target)
        vehicle.step()
        self.texts += [text for _, text in vehicle.take_status_texts()]

    def _send_vision(self) -> None:
        for sample in self.vehicle.simulator.arrived:
            position, attitude = sample.pose[:3], sample.pose[3:]
            if self.mangle is not None:
                position, attitude = self.mangle(position, attitude)
            self.vehicle.vision(sample.captured * 1000, position, attitude)

    def fly(self, seconds: float, target: OffboardSetpoint | None = None) -> Array:
        """Go on, by another target if there is one; return the true state of each tick (N, 13)."""
        self.target = target or self.target
        rows = np.empty((round(seconds * 1000), 13))
        for row in rows:
            self.step()
            row[:] = numbers(self.vehicle.simulator.plant.state)
        return rows

    def fly_until(self, done: Callable[[], bool], seconds: float) -> float:
        """Go on until `done`, at most `seconds`; return how long it took [s]."""
        for tick in range(round(seconds * 1000)):
            if done():
                return tick * 1e-3
            self.step()
        raise AssertionError(f"not within {seconds} s; said: {self.texts}")

    def arm_offboard(self, target: OffboardSetpoint) -> None:
        """Begin to stream, change the mode and arm."""
        self.fly(0.1, target)
        assert self.vehicle.set_mode(OFFBOARD) == Result.ACCEPTED
        self.fly(0.1)
        assert self.vehicle.arm() == Result.ACCEPTED, self.vehicle.take_status_texts()

    def take_off(self, height: float | None = None) -> None:
        """Ask for a take-off in AUTO, and arm."""
        assert self.vehicle.takeoff(height) == self.vehicle.arm() == Result.ACCEPTED

    def offboard(self, x: float = 0.0, y: float = 0.0, z: float = 2.0) -> None:
        """Take off by set points and hold there."""
        self.arm_offboard(motion([x, y, z], yaw=0.0))
        self.fly(8.0)
        assert np.linalg.norm(self.body[:3] - [x, y, z]) < 0.15, self.body[:3]

    def heard(self, text: str) -> bool:
        """Whether a message with this text was said."""
        return any(text in sent for sent in self.texts)


@lru_cache
def _ready(vision: bool) -> Flight:
    flight = Flight(vision=vision)
    flight.fly(2.0)
    return flight


@lru_cache
def _hovering(vision: bool) -> Flight:
    flight = copy.deepcopy(_ready(vision))
    flight.offboard()
    return flight


def ready(vision: bool = False) -> Flight:
    """A vehicle on the ground that knows where it is."""
    return copy.deepcopy(_ready(vision))


def hovering(vision: bool = False) -> Flight:
    """A vehicle in OFFBOARD at a height of 2 m, with a stream."""
    return copy.deepcopy(_hovering(vision))

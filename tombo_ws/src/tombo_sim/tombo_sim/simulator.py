"""The vehicle tick by tick, for whoever brings the commands: the node, a test, a link to PX4."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import taking_rows
from tombo_dynamics.rigid_body import finish_tick
from tombo_dynamics.rotation import upright
from tombo_dynamics.time_base import TICK_NS, TICK_S
from tombo_sim.flight_setup import NOISE, begin
from tombo_sim.normals import draw_normals, stream_of
from tombo_sim.sensing import Captures, MocapEntry, capture_pose, read_imu
from tombo_sim.world import World

_BLOCK = 4096


@dataclass(frozen=True)
class PoseSample:
    """A pose of the motion capture."""

    captured: int
    """Tick of capture, as the stamp says it."""
    stamp_ns: int
    """The stamp [ns since tick 0]."""
    arrives: int
    """Tick of arrival."""
    pose: Array
    """(7) position in map [m], quaternion xyzw."""


_read_imu, _finish_tick = taking_rows(read_imu, 2), taking_rows(finish_tick, 1)


class Simulator:
    """One vehicle in its world. The same seed gives the same chance as in the headless flight.

    `tick` is the present one; its IMU sample and truth are there. `advance` takes the command that
    answers it.
    """

    def __init__(self, world: World, seed: int) -> None:
        """Set the vehicle on the ground, at tick 0.

        Raises:
            InputError: as `flight_setup.begin`.
        """
        self.setup = setup = begin(world, seed)
        self.plant = setup.plant
        self._plants = setup.plant.as_array()
        self._maps, self._theta = setup.maps.as_array(), setup.theta
        self.tick = 0
        self._rate = setup.mocap_rate
        self._stream, self._noise = stream_of(setup.tick_noise), np.empty((_BLOCK, NOISE))
        draw_normals(self._stream, self._noise)
        self._captured = 0
        self._entries = np.zeros(1, MocapEntry.layout)
        self._captures = Captures.new()
        self._under_way: list[PoseSample] = []
        self.arrived: list[PoseSample] = []
        """Poses that arrive in the present tick."""
        _read_imu(self._plants, self._maps, self._noise[0], self._theta)
        self._capture()

    def advance(self, command: Array) -> None:
        """Finish the tick with rotor speeds (4) [rad/s] asked for, and sense at the next one."""
        self._plants["rotor_command"][0] = command
        _finish_tick(self._plants, self._noise[self.tick % _BLOCK], self._theta)
        self.tick += 1
        if self.tick % _BLOCK == 0:
            draw_normals(self._stream, self._noise)
        _read_imu(self._plants, self._maps, self._noise[self.tick % _BLOCK], self._theta)
        self._capture()

    @property
    def gyro(self) -> Array:
        """(3) [rad/s], base_link, as measured."""
        gyro: Array = self._plants["gyro"][0]
        return gyro

    @property
    def accel(self) -> Array:
        """(3) specific force [m/s^2], base_link, as measured."""
        accel: Array = self._plants["accel"][0]
        return accel

    @property
    def imu(self) -> Array:
        """(6) gyro [rad/s] and specific force [m/s^2], base_link, as measured."""
        return np.concatenate((self.gyro, self.accel))

    @property
    def height(self) -> float:
        """True height of base_link [m]."""
        return float(self._plants["state"]["position"][0, 2])

    @property
    def upright(self) -> float:
        """Cosine of the true tilt."""
        return upright(self._plants["state"]["attitude"][0])

    def _capture(self) -> None:
        due = round(self._captured * (1.0 / self._rate) / TICK_S)
        if self.tick >= due:
            self._captured += 1
            noise = self.setup.mocap_noise.standard_normal((1, NOISE))
            self._captures.next = 0
            capture_pose(
                self.plant, noise, self.setup.theta, self._entries, self._captures, self.tick
            )
            entry = self._entries[0]
            if entry.arrives >= 0:
                self._under_way.append(
                    PoseSample(
                        math.floor(entry.stamp + 0.5),
                        round(float(entry.stamp) * TICK_NS),
                        int(entry.arrives),
                        np.concatenate((entry.position, entry.attitude)),
                    )
                )
        self.arrived = [s for s in self._under_way if s.arrives <= self.tick]
        if self.arrived:
            self._under_way = [s for s in self._under_way if s.arrives > self.tick]

"""The vehicle tick by tick, for whoever brings the commands: the node, a test, a link to PX4."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import P, part
from tombo_dynamics.rigid_body import finish_tick
from tombo_dynamics.time_base import TICK_NS, TICK_S
from tombo_sim.flight_setup import NOISE, begin
from tombo_sim.kernel import (
    ARRIVES,
    MOCAP_WIDTH,
    NEXT_CAPTURE,
    POSE,
    STAMPED,
    capture_pose,
    read_imu,
    stamped_tick,
)
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


class Simulator:
    """One vehicle in its world. The same seed gives the same chance as in the headless flight.

    `tick` is the present one; its IMU sample and truth are there. `advance` takes the command that
    answers it.
    """

    def __init__(self, world: World, seed: int) -> None:
        """Set the vehicle on the ground, at tick 0.

        Raises:
            InputError: as `beginning.begin`.
        """
        self.setup = begin(world, seed)
        self.m = self.setup.m
        """Memory of the plant, `tombo_dynamics.plant.P`."""
        self.tick = 0
        self._rate = world.mocap_rate
        self._noise = self.setup.tick_noise.standard_normal((_BLOCK, NOISE))
        self._captures = 0
        self._row = np.zeros((1, MOCAP_WIDTH))
        self._state = np.zeros(3, dtype=np.int64)
        self._under_way: list[PoseSample] = []
        self.arrived: list[PoseSample] = []
        """Poses that arrive in the present tick."""
        self._sense()

    def advance(self, command: Array) -> None:
        """Finish the tick with rotor speeds (4) [rad/s] asked for, and sense at the next one."""
        part(self.m, "command")[:] = command
        finish_tick(self.m, self._noise[self.tick % _BLOCK], self.setup.theta)
        self.tick += 1
        if self.tick % _BLOCK == 0:
            self._noise = self.setup.tick_noise.standard_normal((_BLOCK, NOISE))
        self._sense()

    @property
    def imu(self) -> Array:
        """(6) gyro [rad/s] and specific force [m/s^2], base_link, as measured."""
        return part(self.m, "imu")

    @property
    def height(self) -> float:
        """True height of base_link [m]."""
        return float(self.m[P.body + 2])

    @property
    def upright(self) -> float:
        """Cosine of the true tilt."""
        return float(1.0 - 2.0 * (self.m[P.body + 6] ** 2 + self.m[P.body + 7] ** 2))

    def _sense(self) -> None:
        read_imu(self.m, self.setup.maps, self._noise[self.tick % _BLOCK], self.setup.theta)
        due = round(self._captures * (1.0 / self._rate) / TICK_S)
        if self.tick >= due:
            self._captures += 1
            noise = self.setup.mocap_noise.standard_normal((1, NOISE))
            self._state[NEXT_CAPTURE] = 0
            capture_pose(self.m, noise, self.setup.theta, self._row, self._state, self.tick)
            row = self._row[0]
            if row[ARRIVES] >= 0.0:
                self._under_way.append(
                    PoseSample(
                        stamped_tick(self._row, 0),
                        round(float(row[STAMPED]) * TICK_NS),
                        int(row[ARRIVES]),
                        row[POSE : POSE + 7].copy(),
                    )
                )
        self.arrived = [s for s in self._under_way if s.arrives <= self.tick]
        if self.arrived:
            self._under_way = [s for s in self._under_way if s.arrives > self.tick]

"""One flight of the Tombo vehicle with an autopilot on the other side: controls in, messages out.

No socket and no clock: `step` is one HIL_SENSOR interval; `tombo_px4.hil.lockstep` runs it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common

from tombo_dynamics.arrays import Array
from tombo_dynamics.time_base import TICK_NS
from tombo_px4.hil.motor_mapping import MotorMapping
from tombo_px4.hil.params import HilParams
from tombo_px4.hil.sensors import HilSensors
from tombo_px4.link.link_params import ODOMETRY
from tombo_px4.link.message_encoder import pose_message
from tombo_sim.simulator import PoseSample, Simulator
from tombo_sim.world import World

SYSTEM, COMPONENT = 1, 200
"""Who PX4's simulators say they are."""
INERTIAL = 0x3F
"""Accelerometer and gyro."""
ALL_SENSORS = 0x1FFF
"""Also magnetometer, barometer, differential pressure, temperature: each group complete."""
SLOW_SENSORS_EVERY = 5
"""Messages from one with all sensors to the next: 50 Hz of 250."""
TICK_US = TICK_NS // 1000
Watch = Callable[[Simulator], None]


class MotorCommands(NamedTuple):
    """Commands of PX4: the content of HIL_ACTUATOR_CONTROLS."""

    controls: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
    armed: bool = False


class HilFlight:
    """One vehicle, from the ground. The same seed gives the same random draws.

    Attributes:
        simulator: the plant, with the ground truth.
        poses: motion-capture poses that arrived during the last step; `captured` and `arrives` are
            ticks, `TICK_US` times a tick is PX4's clock.
        rotors: commanded rotor speeds of the last step [rad/s].
    """

    def __init__(
        self,
        world: World,
        seed: int,
        params: HilParams,
        watch: Watch | None = None,
        hand: Watch | None = None,
    ) -> None:
        """Set the vehicle on the ground.

        `watch` is called at every tick after the first; `hand` before its samples are taken.

        Raises:
            InputError: as `Simulator`.
        """
        self._watch = watch
        self._hand = hand
        self.params = params
        self.simulator = Simulator(world, seed)
        self.sensors = HilSensors(params, seed)
        self.controls = MotorMapping(world.vehicle, self.simulator.setup.maps, params.mapping)
        self.poses: list[PoseSample] = []
        self.rotors: Array = np.zeros(4)
        self.steps = 0
        self._mav = common.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._slow: tuple[float, ...] = ()
        self._gps_due = _RateTimer(params.gps_rate if params.gps else 0.0)
        self._truth_due = _RateTimer(params.truth_rate)

    @property
    def time_us(self) -> int:
        """Time of the present tick: PX4's clock."""
        return self.simulator.tick * TICK_US

    def set_truth_interval(self, interval_us: float) -> None:
        """Set the interval of HIL_STATE_QUATERNION: -1 none, 0 the default; a set rate stays."""
        if self.params.truth_rate > 0.0:
            return
        rate = 0.0 if interval_us < 0.0 else 1e6 / interval_us if interval_us > 0.0 else 200.0
        self._truth_due = _RateTimer(rate, self.time_us)

    def step(self, motors: MotorCommands) -> bytes:
        """Fly one interval with the motors as wanted; return the frames for PX4, in one piece.

        HIL_SENSOR is the last, because it moves PX4's clock and wakes it: what came before is
        there then, in every run alike, taken at the time of the HIL_SENSOR before.
        """
        self.rotors = self.controls.speeds(motors.controls, motors.armed)
        simulator, sensors = self.simulator, self.sensors
        self.poses = []
        for _ in range(self.params.ticks):
            simulator.advance(self.rotors)
            if self._hand is not None:
                self._hand(simulator)
            sensors.observe(simulator.imu)
            if simulator.arrived:
                # a wrong stamp may lie before PX4's clock began, for which it has no number
                self.poses += [pose for pose in simulator.arrived if pose.stamp_ns >= 0]
            if self._watch is not None:
                self._watch(simulator)
        self.steps += 1
        messages = []
        now = (self._mav, self.time_us, simulator.plant)
        if self.steps > 1:
            if self._gps_due.is_due(self.time_us):
                messages.append(sensors.gps(*now))
            if self._truth_due.is_due(self.time_us):
                messages.append(sensors.truth(*now))
            if self.params.mocap:
                messages += [odometry(pose) for pose in self.poses]
        messages.append(self._sensor())
        return b"".join(bytes(message.pack(self._mav)) for message in messages)

    def _sensor(self) -> Any:
        fields = INERTIAL
        if (self.steps - 1) % SLOW_SENSORS_EVERY == 0:
            self._slow = self.sensors.slow(self.simulator.plant)
            fields = ALL_SENSORS
        inertial = self.sensors.inertial()
        return self._mav.hil_sensor_encode(self.time_us, *inertial, *self._slow, fields, 0)


def odometry(pose: PoseSample) -> Any:
    """Return a motion-capture pose as the message PX4 fuses, stamped in PX4's own clock."""
    return pose_message(ODOMETRY, pose.stamp_ns, pose.pose[:3], pose.pose[3:], None)


class _RateTimer:
    """Timer for a rate that need not divide the rate of the steps."""

    def __init__(self, rate: float, now_us: int = 0) -> None:
        self._period_us = 1e6 / rate if rate > 0.0 else 0.0
        self._next_us = float(now_us)

    def is_due(self, now_us: int) -> bool:
        if self._period_us == 0.0 or now_us < self._next_us:
            return False
        self._next_us += self._period_us
        return True

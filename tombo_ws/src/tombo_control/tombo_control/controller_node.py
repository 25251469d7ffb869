"""The controller as a node: rates at 1000 Hz on the gyro, attitude at 250, position at 50 Hz."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    ESTIMATOR_STATUS,
    IMU,
    ODOMETRY,
    RATES_SETPOINT,
    ROTOR_COMMAND,
    SETPOINT,
)
from tombo_control.controller_core import Command, ControllerCore
from tombo_control.estimate import Estimate, Setpoint, nearest_tick
from tombo_control.params import (
    ATTITUDE_TICKS,
    POSITION_TICKS,
    RATE_TICKS,
    ControlParams,
    InputLimits,
)
from tombo_dynamics.propeller import thrust_map
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_configuration
from tombo_dynamics.rotation import rotate_vectors
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_dynamics.vehicle import VehicleParams
from tombo_ros.conversion import array, to_ns
from tombo_ros.health import ERROR
from tombo_ros.loop_statistics import LoopStatistics
from tombo_ros.message_template import MessageTemplate
from tombo_ros.node_loop import SECOND_NS, LoopNode, run
from tombo_ros.pacing import CONTROLLER, sleep_until
from tombo_ros.topic import ReceivedMessage

_MARGIN_NS = 250_000
"""The loop aims to run this long after a gyro sample has arrived."""
_FOLLOW = 0.02
"""Share of the distance to that aim that is made good in each run."""
_FASTEST_NS = 1000
"""And at most so much in each: 0.1 % of the rate."""
_SLOW_TURN = 4
"""Set points and biases come 50 times a second: they are looked for in some runs only."""
_WAIT_NS, _LOOKS = 100_000, 4
"""A sample that is late is looked for again so often, so far apart."""
_AHEAD_NS = 5_000_000
"""An estimate may be stamped so far ahead of the clock."""
_BLIND_TEXT = "position unknown (estimate or mocap too old): level descent"


class ControllerNode(LoopNode):
    """Runs `ControllerCore`, once for each gyro sample."""

    def __init__(self) -> None:
        """Declare parameters and topics."""
        records = {
            "control": ControlParams(),
            "inputs": InputLimits(),
            "vehicle": VehicleParams(),
            "propeller": PropellerChoice(),
        }
        super().__init__("controller", 1000.0, records, priority=CONTROLLER)
        r = self.records
        propeller = r["propeller"]
        maps = rotor_maps(
            thrust_map(mounted_configuration(propeller), propeller.law), r["vehicle"]
        )
        self._controller = ControllerCore(r["control"], r["vehicle"], r["inputs"], maps)
        self._warm_up()
        self.loops = {
            "loop": LoopStatistics(),
            "rate loop": LoopStatistics(),
            "attitude loop": LoopStatistics(),
            "position loop": LoopStatistics(),
        }
        self._imu_in = self.subscribe(IMU, depth=20)
        self._odometry_in = self.subscribe(ODOMETRY, depth=20)
        self._status_in = self.subscribe(ESTIMATOR_STATUS)
        self._setpoint_in = self.subscribe(SETPOINT)
        body, world = {"frame_id": "base_link"}, {"frame_id": "map"}
        self._imu = MessageTemplate(
            IMU.typename, {"header": body, "orientation_covariance": [-1.0] + 8 * [0.0]}
        )
        self._gyro = self._imu.field("angular_velocity.x", 3)
        self._odometry = MessageTemplate(
            ODOMETRY.typename, {"header": world, "child_frame_id": "base_link"}
        )
        self._pose = self._odometry.field("pose.pose.position.x", 7)
        self._twist = self._odometry.field("twist.twist.linear.x", 6)
        self._command_out, self._command = (
            self.advertise(ROTOR_COMMAND),
            MessageTemplate(ROTOR_COMMAND.typename, {"header": body}),
        )
        self._speed = self._command.field("speed", 4)
        self._rates_out, self._rates = (
            self.advertise(RATES_SETPOINT),
            MessageTemplate(RATES_SETPOINT.typename, {"header": body}),
        )
        self._attitude_out, self._attitude = (
            self.advertise(ATTITUDE_SETPOINT),
            MessageTemplate(ATTITUDE_SETPOINT.typename, {"header": world}),
        )
        self._late_samples = 0
        self._stamp_ns = 0
        """Of the last gyro sample."""
        self._runs = 0
        self._slots: dict[str, int] = {}
        self._refused = 0

    def _warm_up(self) -> None:
        """Load all compiled code now, not at the first sample."""
        r = self.records
        propeller = r["propeller"]
        maps = rotor_maps(
            thrust_map(mounted_configuration(propeller), propeller.law), r["vehicle"]
        )
        spare = ControllerCore(r["control"], r["vehicle"], r["inputs"], maps)
        zero, level = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
        second = 1_000_000_000
        for k in range(25):
            now = second + k * 1_000_000
            spare.estimate(Estimate(now, zero, zero, level, zero, zero, zero, now))
            spare.biases(zero, now)
            spare.setpoint(Setpoint(zero, zero, zero, 0.0, 2), now)
            spare.tick(now, now, zero)
        rotate_vectors(level, zero)

    def on_parameters_changed(self, name: str) -> None:
        """Take new gains in flight; another vehicle or propeller only at the next start."""
        if name in ("control", "inputs"):
            self._controller.params(self.records["control"], self.records["inputs"])
        else:
            self.health.fault("not_at_runtime", True, f"{name} is used at the next start")

    def step(self, now_ns: int) -> None:
        """Answer the gyro first; take the rest after it, for the next sample.

        In simulated time nothing is urgent: there the rest comes first, as it was sent.
        """
        if self.sim_time:
            self._take_rest(now_ns)
            self._answer_gyro(now_ns)
        else:
            self._answer_gyro(now_ns)
            self._runs += 1
            self._take_rest(now_ns, self._runs % _SLOW_TURN)

    def _take_rest(self, now_ns: int, turn: int = 0) -> None:
        if self._odometry_in.waiting():
            self._take_odometry(now_ns)
        if turn == 0 and self._status_in.waiting():
            self._take_status()
        if turn in (0, 2) and self._setpoint_in.waiting():
            self._take_setpoint(now_ns)

    def _answer_gyro(self, now_ns: int) -> None:
        samples = self._gyro_samples()
        if not samples:
            self._without_gyro()
            return
        if self.health.active("imu_silent"):
            self.health.fault("imu_silent", False)
        if self._imu_in.multiple_publishers(time.time_ns()):
            return
        if not self.sim_time:
            self._follow(now_ns - samples[-1].received_ns)
            self._late_samples += len(samples) - 1
        for taken in samples:  # two at a time if the first came too late for its run
            self._answer(taken.message, now_ns)

    def _gyro_samples(self) -> list[ReceivedMessage]:
        """Return the samples that are there; for one that is late, wait a moment."""
        samples = self._imu_in.take_raw()
        for _ in range(0 if self.sim_time or self._imu_in.last_ns is None else _LOOKS):
            if samples:
                break
            sleep_until(time.monotonic_ns() + _WAIT_NS)
            samples = self._imu_in.take_raw()
        return samples

    def _follow(self, age_ns: int) -> None:
        """Move the next deadline so that it falls a margin after a gyro sample's arrival."""
        off = (_MARGIN_NS - age_ns + self.late_ns + self.period_ns // 2) % self.period_ns
        shift = int(_FOLLOW * (off - self.period_ns // 2))
        self.shift_ns = min(max(shift, -_FASTEST_NS), _FASTEST_NS)

    def _answer(self, data: bytes, now_ns: int) -> None:
        if not self._imu.fits(data):
            self.health.report_event("imu_shape", "imu frame is not base_link, or of other shape")
            return
        stamp = self._imu.stamp_of(data)
        rates = self._gyro.of(data)
        gyro = np.array(rates)
        if not math.isfinite(rates[0] + rates[1] + rates[2]):
            self.health.report_event("imu_not_finite", "gyro sample with NaN or infinity")
        if self.sim_time and stamp < self._stamp_ns - SECOND_NS:
            # A new simulation. The last flight's set point would lift the vehicle off.
            self._controller.reset_inputs()
        self._stamp_ns = stamp
        clock = stamp if self.sim_time else now_ns
        command = self._controller.tick(clock, stamp, gyro)
        if command is None:
            return
        self._command.stamp(stamp)
        self._speed.put(command.speed)
        self._command_out.publish(self._command.data())
        self._tell(command, now_ns)

    def _tell(self, command: Command, now_ns: int) -> None:
        tick = nearest_tick(command.stamp_ns)
        self._count("rate loop", tick, RATE_TICKS, now_ns)
        if command.attitude_ran:
            self._count("attitude loop", tick, ATTITUDE_TICKS, now_ns)
            rates, thrust = self._controller.rates_setpoint
            self._rates.stamp(command.stamp_ns)
            self._rates.set("rates.x", *rates)
            self._rates.set("thrust", thrust)
            self._rates_out.publish(self._rates.data())
        if command.position_ran:
            self._count("position loop", tick, POSITION_TICKS, now_ns)
            attitude, thrust = self._controller.attitude_setpoint
            self._attitude.stamp(command.stamp_ns)
            self._attitude.set("orientation.x", *attitude)
            self._attitude.set("thrust", thrust)
            self._attitude_out.publish(self._attitude.data())
            self.health.fault("blind", command.blind, _BLIND_TEXT, ERROR)
            self.health.fault("setpoint_silent", command.held, "no set point: holding the last")

    def _count(self, loop: str, tick: int, period: int, now_ns: int) -> None:
        """Count a run; what lies between its slot and the last one's was missed."""
        slot = tick // period
        last, self._slots[loop] = self._slots.get(loop, slot - 1), slot
        self.loops[loop].ran(now_ns, self.late_ns, max(slot - last - 1, 0))

    def _without_gyro(self) -> None:
        limit = self.records["inputs"].imu_timeout
        silent = self._imu_in.silent(time.time_ns(), 0.5 if self.sim_time else limit)
        self.health.fault("imu_silent", silent, "no gyro: no commands", ERROR)

    def _take_odometry(self, now_ns: int) -> None:
        for taken in self._odometry_in.take_raw():
            data = taken.message
            if self._odometry_in.multiple_publishers(time.time_ns()):
                continue
            if not self._odometry.fits(data):
                self._refuse("odometry", "odometry is not of base_link in map")
                continue
            pose, twist = np.array(self._pose.of(data)), np.array(self._twist.of(data))
            stamp = self._odometry.stamp_of(data)
            velocity = rotate_vectors(pose[3:], twist[:3])
            zero = np.zeros(3)
            estimate = Estimate(stamp, pose[:3], velocity, pose[3:], twist[3:], zero, zero, 0)
            if stamp > now_ns + _AHEAD_NS + self.slack_ns or not self._controller.estimate(
                estimate
            ):
                self._refuse("odometry", "odometry not finite, not a rotation, old or from later")

    def _take_status(self) -> None:
        for taken in self._status_in.take():
            message = taken.message
            if not self._controller.biases(array(message.gyro_bias), to_ns(message.pose_stamp)):
                self._refuse("estimator_status", "gyro bias with NaN")

    def _take_setpoint(self, now_ns: int) -> None:
        for taken in self._setpoint_in.take():
            if self._setpoint_in.multiple_publishers(time.time_ns()):
                continue
            setpoint = _setpoint(taken.message)
            if self.sim_time and setpoint.stamp_ns > max(self._stamp_ns, now_ns) + SECOND_NS:
                self._refuse("setpoint", "set point from later: of a simulation before this one?")
            elif not self._controller.setpoint(setpoint, now_ns):
                self._refuse("setpoint", "set point with NaN or infinity: the last one stands")

    def _refuse(self, what: str, text: str) -> None:
        self._refused += 1
        self.health.report_event(f"{what}_refused", text)

    def report(self, now_ns: int) -> None:
        """Add the counts."""
        self.health.value("gyro_late", self._late_samples)
        self.health.value("refused", self._refused)
        super().report(now_ns)


def _setpoint(message: Any) -> Setpoint:
    return Setpoint(
        array(message.position),
        array(message.velocity),
        array(message.acceleration),
        float(message.yaw),
        int(message.phase),
        to_ns(message.header.stamp),
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Run the node."""
    sys.exit(run(ControllerNode, argv))


if __name__ == "__main__":
    main()

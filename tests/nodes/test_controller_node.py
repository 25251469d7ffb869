"""The controller as a node: each gyro sample gets a command with its stamp."""

from __future__ import annotations

import time

import numpy as np
import pytest

from in_time import in_time

pytest.importorskip("rclpy")

from nav_msgs.msg import Odometry
from parameter_calls import set_parameters
from sensor_msgs.msg import Imu

from ros_bench import point, vector
from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    CLOCK,
    DIAGNOSTICS,
    ESTIMATOR_STATUS,
    IMU,
    ODOMETRY,
    RATES_SETPOINT,
    ROTOR_COMMAND,
    SETPOINT,
)
from tombo_dynamics.messages import Phase
from tombo_msgs.msg import EstimatorStatus, PositionSetpoint
from tombo_ros.conversion import to_ns, to_time

_MS = 1_000_000
_ZERO, _LEVEL = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])


class _Inputs:
    """A vehicle that hovers at 2 m, rolling to and fro, 0.3 m off its set point."""

    def __init__(self, world) -> None:
        self.world = world
        self.patience_s = 0.05
        """Wait for an answer while none has come yet."""

    def tick(self, *, setpoint: bool = True, estimate: bool = True, **more) -> int:
        """Send what belongs to the next millisecond; wait for the answer to the gyro."""
        world = self.world
        stamp = world.now_ns + _MS
        if estimate and stamp % (4 * _MS) == 0:
            world.publish(ODOMETRY, self.odometry(stamp))
        if stamp % (20 * _MS) == 0:
            status = EstimatorStatus(initialised=True, pose_stamp=to_time(stamp))
            status.header.stamp, status.header.frame_id = to_time(stamp), "base_link"
            world.publish(ESTIMATOR_STATUS, status)
            if setpoint:
                world.publish(SETPOINT, self.setpoint(stamp, **more))
        world.tick(_MS)
        if stamp % (4 * _MS) == 0:
            time.sleep(0.003)  # messages due with the gyro sample shall arrive before it
        imu = Imu()
        imu.header.stamp, imu.header.frame_id = to_time(stamp), "base_link"
        imu.angular_velocity.x = 0.3 * float(np.sin(20e-9 * stamp))
        world.publish(IMU, imu)
        answers = world.heard[ROTOR_COMMAND.name]
        answered = bool(answers)
        end = time.monotonic() + (30.0 if answered else self.patience_s)
        while time.monotonic() < end:
            world.hear()
            if answers and to_ns(answers[-1].header.stamp) == stamp:
                return stamp
            time.sleep(0.0001)
        assert not answered, "no answer"
        return stamp

    def odometry(self, stamp: int) -> Odometry:
        message = Odometry()
        message.header.stamp, message.header.frame_id = to_time(stamp), "map"
        message.child_frame_id = "base_link"
        message.pose.pose.position = point((0.3, 0.0, 2.0))
        message.pose.pose.orientation.w = 1.0
        return message

    def setpoint(self, stamp: int, phase: int = Phase.TAKEOFF) -> PositionSetpoint:
        message = PositionSetpoint()
        message.header.stamp, message.header.frame_id = to_time(stamp), "map"
        message.position, message.velocity = point((0.0, 0.0, 2.0)), vector(_ZERO)
        message.phase = phase
        return message


def _tilt(setpoint) -> float:
    return 2.0 * float(np.arcsin(np.hypot(setpoint.orientation.x, setpoint.orientation.y)))


@pytest.mark.slow
def test_a_controller_that_stands_by_misses_no_run_of_its_loops(world, start):
    world.subscribe(ROTOR_COMMAND, DIAGNOSTICS)
    node = start("tombo_control.controller_node", "-p", "use_sim_time:=true")
    world.meet(IMU, ODOMETRY, ESTIMATOR_STATUS, SETPOINT, CLOCK, ROTOR_COMMAND)
    inputs = _Inputs(world)
    world.now_ns = 10_000 * _MS
    end = time.monotonic() + 60.0
    while not world.heard[ROTOR_COMMAND.name]:
        inputs.tick(setpoint=False)
        assert time.monotonic() < end
    stood_ns = world.now_ns
    inputs.patience_s = 0.01  # it does not answer: it was started in flight, for all it knows
    while True:  # until it has stood there for 1.5 s
        answers = world.heard[ROTOR_COMMAND.name]
        answers[:] = [a for a in answers if to_ns(a.header.stamp) > stood_ns]  # not late ones
        if answers:
            break
        inputs.tick()
        assert time.monotonic() < end + 120.0

    def rate_loop(report):
        return [s for s in report.status if s.name == "controller: rate loop"]

    (status,) = rate_loop(world.wait_for(DIAGNOSTICS, rate_loop))
    assert int({pair.key: pair.value for pair in status.values}["missed"]) < 100
    assert node.end() == 0


@pytest.mark.real_time
def test_each_gyro_sample_is_answered_once_and_a_gain_acts_in_flight(world, start):
    world.subscribe(ROTOR_COMMAND, RATES_SETPOINT, ATTITUDE_SETPOINT, DIAGNOSTICS)
    node = start("tombo_control.controller_node", "-p", "use_sim_time:=true")
    world.meet(IMU, ODOMETRY, ESTIMATOR_STATUS, SETPOINT, CLOCK, ROTOR_COMMAND, RATES_SETPOINT)
    inputs = _Inputs(world)
    world.now_ns = 10_000 * _MS

    end = time.monotonic() + 60.0
    while not world.heard[ROTOR_COMMAND.name]:  # until all have found each other
        inputs.tick(setpoint=False)
        assert time.monotonic() < end
    for _ in range(40):  # nobody has said where to
        inputs.tick(setpoint=False)
    assert not any(any(m.speed) for m in world.heard[ROTOR_COMMAND.name])
    assert not world.heard[ATTITUDE_SETPOINT.name]

    for _ in range(40):
        inputs.tick(phase=Phase.IDLE)
    assert not any(any(m.speed) for m in world.heard[ROTOR_COMMAND.name])

    first = len(world.heard[ROTOR_COMMAND.name])
    stamps = [inputs.tick() for _ in range(400)]
    answers = world.heard[ROTOR_COMMAND.name][first:]
    assert [to_ns(m.header.stamp) for m in answers] == stamps  # each once, in order
    assert {m.header.frame_id for m in answers} == {"base_link"}

    with in_time():
        assert len(world.heard[RATES_SETPOINT.name]) == pytest.approx(100, abs=6)
        assert len(world.heard[ATTITUDE_SETPOINT.name]) == pytest.approx(20, abs=2)

    leaning = _tilt(world.heard[ATTITUDE_SETPOINT.name][-1])
    assert leaning > 0.07
    assert set_parameters(world, "controller", control__tilt_max=0.05) == [(True, "")]
    for _ in range(45):
        inputs.tick()
    assert _tilt(world.heard[ATTITUDE_SETPOINT.name][-1]) == pytest.approx(0.05, abs=1e-3)
    assert min(world.heard[ROTOR_COMMAND.name][-1].speed) > 300.0
    assert node.end() == 0

"""The simulator as a node: its start, its clock, and without commands."""

from __future__ import annotations

import math
import time

import pytest

from in_time import in_time

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from parameter_calls import set_parameters
from reports import finding, heard

from tombo_bag.topics import CLOCK, DIAGNOSTICS, IMU, ROTOR_COMMAND, TRUE_ODOMETRY
from tombo_msgs.msg import RotorSpeeds
from tombo_ros.conversion import to_ns, to_time

_MS = 1_000_000


def _command(stamp_ns: int, speed: float) -> RotorSpeeds:
    message = RotorSpeeds()
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), "base_link"
    message.speed = [speed] * 4
    return message


def _wait(world, condition, patience_s=60.0):
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end
        world.hear()
        time.sleep(0.001)


def test_in_real_time_the_flight_begins_when_the_other_nodes_are_there(world, start):
    world.subscribe(IMU, DIAGNOSTICS)
    sim = start("tombo_sim.sim_node", "-p", "starts_after:=pilot navigator")
    world.meet(IMU, DIAGNOSTICS)
    told_of = len(world.heard[DIAGNOSTICS.name])

    def report(*names: str) -> int:
        status = [DiagnosticStatus(name=name) for name in names]
        world.publish(DIAGNOSTICS, DiagnosticArray(status=status))
        return time.time_ns()

    for _ in range(3):  # of its own reports, one a second
        told_of += 1
        _wait(world, lambda n=told_of: len(world.heard[DIAGNOSTICS.name]) >= n)
        report("pilot")
    assert not world.heard[IMU.name]
    came_ns = report("pilot", "navigator")
    _wait(world, lambda: world.heard[IMU.name], 30.0)
    assert (
        to_ns(world.heard[IMU.name][0].header.stamp) - came_ns > 1000 * _MS
    )  # they have met meanwhile
    assert sim.end() == 0


def test_a_node_that_does_not_come_is_told_and_the_flight_begins(world, start):
    world.subscribe(IMU, DIAGNOSTICS)
    start("tombo_sim.sim_node", "-p", "starts_after:=pilot", "-p", "start_patience:=2.0")
    finding(world, "sim", "nodes_missing", text="begins without pilot", since=0)
    _wait(world, lambda: world.heard[IMU.name])


@pytest.mark.real_time
def test_in_simulated_time_it_climbs_lands_on_its_own_and_stands_still(world, start):
    """Commanded up, then by nobody, at four times the speed of the wall's clock; then paused."""
    world.subscribe(TRUE_ODOMETRY, CLOCK, DIAGNOSTICS)
    simulated = ("-p", "use_sim_time:=true", "-p", "speed:=4.0")
    node = start("tombo_sim.sim_node", *simulated)
    world.meet(ROTOR_COMMAND, TRUE_ODOMETRY, CLOCK)

    def clock_ns() -> int:
        world.hear()
        return to_ns(world.heard[CLOCK.name][-1].clock)

    def climb() -> None:
        world.publish(ROTOR_COMMAND, _command(clock_ns(), 610.0))

    heard(world, CLOCK)
    heard(world, TRUE_ODOMETRY, lambda m: m.pose.pose.position.z > 0.5, meanwhile=climb)
    assert "landing on its own" in finding(world, "sim", "failsafe")
    for stamp_ns, speed, why in (
        (clock_ns(), math.nan, "is no command"),
        (clock_ns() + 3_600_000 * _MS, 610.0, "future"),
    ):
        world.publish(ROTOR_COMMAND, _command(stamp_ns, speed))
        assert why in finding(world, "sim", "command_refused", text=why)

    began, begin_ns = time.monotonic(), clock_ns()
    _wait(world, lambda: clock_ns() > begin_ns + 1_500 * _MS)
    with in_time():
        assert 0.3 < time.monotonic() - began < 1.3
    assert set_parameters(world, "sim", speed=0.0) == [(True, "")]
    time.sleep(0.2)
    stopped_ns = clock_ns()
    time.sleep(0.2)
    assert clock_ns() == stopped_ns
    assert not set_parameters(world, "sim", speed=-1.0)[0][0]
    assert not set_parameters(world, "sim", seed=4)[0][0]
    assert node.end() == 0

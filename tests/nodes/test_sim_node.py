"""The simulator as a node: paused and stepped, in lockstep, and without commands."""

from __future__ import annotations

import time

import numpy as np
import pytest

from in_time import in_time

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from parameter_calls import set_parameters
from reports import heard, told

from tombo_bag.topics import (
    CLOCK,
    DIAGNOSTICS,
    IMU,
    MOCAP_POSE,
    ROTOR_COMMAND,
    TRUE_ODOMETRY,
    TRUE_ROTORS,
)
from tombo_msgs.msg import RotorSpeeds
from tombo_ros.conversion import array, to_ns, to_time
from tombo_sim.simulator import Simulator
from tombo_sim.world import World

_MS = 1_000_000
_CLIMB = np.full(4, 610.0)
_WORLD = (
    *("-p", "truth_rate:=1000.0", "-p", "use_sim_time:=true", "-p", "seed:=3"),
    *("-p", "effects.imu_noise.accel:=0.3", "-p", "effects.mocap_latency.delay:=0.01"),
)


def _twin() -> Simulator:
    effects = {"imu_noise": {"accel": 0.3}, "mocap_latency": {"delay": 0.01}}
    return Simulator(World(effects=effects), 3)


def _command(stamp_ns: int, speed: np.ndarray) -> RotorSpeeds:
    message = RotorSpeeds()
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), "base_link"
    message.speed = [float(value) for value in speed]
    return message


def _wait(world, condition, patience_s=60.0):
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end
        world.hear()
        time.sleep(0.001)


def _stamps(world, spec) -> list[int]:
    return [to_ns(message.header.stamp) for message in world.heard[spec.name]]


def _true_place(world) -> np.ndarray:
    return array(world.heard[TRUE_ODOMETRY.name][-1].pose.pose.position)


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
    assert _stamps(world, IMU)[0] - came_ns > 1000 * _MS  # they have met meanwhile
    assert sim.end() == 0


def test_a_node_that_does_not_come_is_told_and_the_flight_begins(world, start):
    world.subscribe(IMU, DIAGNOSTICS)
    start("tombo_sim.sim_node", "-p", "starts_after:=pilot", "-p", "start_patience:=2.0")
    told(world, "sim", "nodes_missing", text="begins without pilot", since=0)
    _wait(world, lambda: world.heard[IMU.name])


@pytest.mark.real_time
def test_paused_it_goes_on_by_the_ticks_it_is_told(world, start):
    world.subscribe(IMU, TRUE_ODOMETRY, CLOCK, DIAGNOSTICS)
    node = start("tombo_sim.sim_node", *_WORLD, "-p", "speed:=0.0")
    world.meet(ROTOR_COMMAND, IMU, TRUE_ODOMETRY, CLOCK)
    _wait(world, lambda: world.heard[CLOCK.name])
    zero_ns = to_ns(world.heard[CLOCK.name][-1].clock)

    def step(ticks: int) -> None:
        at = to_ns(world.heard[CLOCK.name][-1].clock)
        assert set_parameters(world, "sim", step=ticks) == [(True, "")]
        _wait(world, lambda: to_ns(world.heard[CLOCK.name][-1].clock) >= at + ticks * _MS)

    sent = 0

    def commanded() -> None:
        """Wait until the node reports another command."""
        nonlocal sent
        sent += 1

        def told_of(report) -> bool:
            values = {pair.key: pair.value for s in report.status for pair in s.values}
            return int(values.get("commands", -1)) >= sent

        world.wait_for(DIAGNOSTICS, told_of)

    step(7)
    _wait(world, lambda: _stamps(world, IMU) and _stamps(world, IMU)[-1] >= zero_ns + 7 * _MS)
    assert _stamps(world, IMU)[-7:] == [zero_ns + k * _MS for k in range(1, 8)]
    assert to_ns(world.heard[CLOCK.name][-1].clock) == zero_ns + 7 * _MS

    twin = _twin()
    for _ in range(7):
        twin.advance(np.zeros(4))
    for _ in range(11):  # up, 40 ms at a time
        world.publish(ROTOR_COMMAND, _command(zero_ns + twin.tick * _MS, _CLIMB))
        commanded()
        step(40)
        for _ in range(40):
            twin.advance(_CLIMB)
    assert twin.height > 0.3
    world.publish(ROTOR_COMMAND, _command(zero_ns + twin.tick * _MS, _CLIMB))
    commanded()
    time.sleep(0.3)  # no time passes: nobody is missed
    step(20)
    for _ in range(20):
        twin.advance(_CLIMB)
    for spec in (TRUE_ODOMETRY, IMU):
        _wait(world, lambda s=spec: _stamps(world, s)[-1] == zero_ns + twin.tick * _MS)
    assert np.array_equal(_true_place(world), twin.plant.state.position)
    gyro_and_force = world.heard[IMU.name][-1]
    assert np.array_equal(array(gyro_and_force.linear_acceleration), twin.imu[3:])

    begun = len(world.heard[DIAGNOSTICS.name])
    step(80)  # now it does: 80 ms without a command, in the air
    assert "landing on its own" in told(world, "sim", "failsafe", begun)

    began, clock = time.monotonic(), to_ns(world.heard[CLOCK.name][-1].clock)
    assert set_parameters(world, "sim", speed=4.0) == [(True, "")]
    _wait(world, lambda: to_ns(world.heard[CLOCK.name][-1].clock) > clock + 1_500 * _MS)
    with in_time():  # 1.5 s at four times the speed of time
        assert 0.3 < time.monotonic() - began < 1.3
    assert not set_parameters(world, "sim", speed=-1.0)[0][0]
    assert not set_parameters(world, "sim", seed=4)[0][0]
    assert node.end() == 0


@pytest.mark.real_time
def test_each_tick_waits_for_its_command_if_asked_to(world, start):
    world.subscribe(IMU, TRUE_ODOMETRY, TRUE_ROTORS, MOCAP_POSE, DIAGNOSTICS)
    node = start("tombo_sim.sim_node", *_WORLD, "-p", "wait_for_command:=true", "-p", "speed:=0.0")
    world.meet(ROTOR_COMMAND, IMU, TRUE_ODOMETRY, MOCAP_POSE)
    set_parameters(world, "sim", step=1)
    _wait(world, lambda: 1_000_000_000 + _MS in _stamps(world, IMU))
    first = _stamps(world, IMU)[-1]
    world.publish(ROTOR_COMMAND, _command(first, _CLIMB))
    time.sleep(0.3)  # longer than a command is waited for; while paused nobody waits
    assert set_parameters(world, "sim", step=450) == [(True, "")]
    answered = len(world.heard[IMU.name])
    began = time.monotonic()
    while len(world.heard[IMU.name]) < answered + 300:
        world.hear()
        stamps = _stamps(world, IMU)
        if stamps[-1] > first:
            with in_time():  # it waits only so long
                assert stamps[-1] == first + _MS  # never two ahead of the commands
            first = stamps[-1]
            world.publish(ROTOR_COMMAND, _command(first, _CLIMB))
        assert time.monotonic() - began < 60.0
    _wait(world, lambda: _stamps(world, IMU)[-1] >= first + _MS)
    time.sleep(0.12)  # longer than command_timeout: then the wall's clock does not count
    world.hear()
    with in_time():
        assert _stamps(world, IMU)[-1] == first + _MS
    world.publish(ROTOR_COMMAND, _command(first + _MS, _CLIMB))
    _wait(world, lambda: _stamps(world, IMU)[-1] == first + 2 * _MS)

    twin = _twin()
    poses = []
    while 1_000_000_000 + twin.tick * _MS < first + 2 * _MS:
        acting = twin.tick >= 1
        twin.advance(_CLIMB if acting else np.zeros(4))
        poses += twin.arrived
    _wait(world, lambda: _stamps(world, TRUE_ODOMETRY)[-1] == first + 2 * _MS)
    assert np.array_equal(_true_place(world), twin.plant.state.position)
    heard = world.heard[MOCAP_POSE.name]
    assert [to_ns(p.header.stamp) for p in heard] == [
        1_000_000_000 + p.captured * _MS for p in poses
    ]
    assert np.array_equal(array(heard[-1].pose.position), poses[-1].pose[:3])

    world.hear()  # the rest of the 450 without answers: it goes on, and says so
    assert "no command came" in told(world, "sim", "wait_for_command")
    assert node.end() == 0


@pytest.mark.real_time
def test_nobody_stops_time_by_commands_of_the_past(world, start):
    world.subscribe(IMU, DIAGNOSTICS)
    node = start("tombo_sim.sim_node", *_WORLD, "-p", "wait_for_command:=true")
    world.meet(ROTOR_COMMAND, IMU)
    _wait(world, lambda: bool(world.heard[IMU.name]))
    first = _stamps(world, IMU)[-1]
    world.publish(ROTOR_COMMAND, _command(first, _CLIMB))
    sent = [time.monotonic()]

    def speak() -> None:
        if time.monotonic() - sent[-1] > 0.01:
            world.publish(ROTOR_COMMAND, _command(first, _CLIMB))
            sent.append(time.monotonic())

    assert "no command came" in told(world, "sim", "wait_for_command", meanwhile=speak)
    began, begin = time.monotonic(), _stamps(world, IMU)[-1]
    heard(world, IMU, lambda m: to_ns(m.header.stamp) > begin + 500 * _MS, meanwhile=speak)
    with in_time():
        assert time.monotonic() - began > 0.4, "without commands time goes on at its own speed"

    world.publish(ROTOR_COMMAND, _command(begin + 3_600_000 * _MS, _CLIMB))
    assert "future" in told(world, "sim", "command_refused")
    assert node.end() == 0

"""Faults of processes in flight, each as a row of the table in docs/faults.md: reported, survived.

The whole suite hovers, slower than in real time; the test publishes what it should not, or kills a
node. One flight serves all rows. Faults of messages are tried with the cores, without nodes.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from in_time import NotInTime, in_time
from ros_bench import Counterpart, NodeProcess, failed, ros_domain

pytest.importorskip("rclpy")

from parameter_calls import call_trigger

from tombo_bag.topics import (
    DIAGNOSTICS,
    MISSION_STATUS,
    ROTOR_COMMAND,
    SETPOINT,
    TRUE_ODOMETRY,
    TopicSpec,
)
from tombo_msgs.msg import MissionStatus, PositionSetpoint, RotorSpeeds
from tombo_ros.conversion import to_ns, to_time

pytestmark = pytest.mark.real_time

ROOT = Path(__file__).parents[2]
HEIGHT = 1.5
HOVER = """
/**:
  ros__parameters:
    use_sim_time: true
    speed: 0.4
    seed: 3
    mission: {takeoff_time: 0.2, height: 1.5, climb_speed: 1.0, approach_time: 3000.0,
              land_time: 3500.0, hold_time: 600.0}
    effects: {mocap_noise: {position: 0.0007, attitude: 0.002},
              mocap_latency: {delay: 0.01, jitter: 0.001},
              imu_noise: {gyro: 0.01, accel: 0.3}}
"""
NODES = {
    "sim": "tombo_sim.sim_node",
    "estimator": "tombo_control.estimator_node",
    "controller": "tombo_control.controller_node",
    "mission": "tombo_control.mission_node",
    "detector": "tombo_collision.detector_node",
    "reaction": "tombo_collision.reaction_node",
}


class Suite(SimpleNamespace):
    """The suite in hover."""

    world: Counterpart
    nodes: dict[str, NodeProcess]
    mark: int

    def start(self, name: str) -> None:
        log = self.folder / f"{name}-{len(os.listdir(self.folder))}.log"
        self.nodes[name] = NodeProcess(NODES[name], ["--params-file", str(self.file)], log)

    def kill(self, name: str) -> None:
        process = self.nodes[name].process
        process.kill()
        process.wait()

    def settle_or_begin_again(self) -> None:
        """Wait for the hover; if the vehicle has landed, the mission is over: fly again."""
        self.wait(0.5)
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            states = self.wait(1.0)
            if furthest(states) < 0.3:
                return self.settle()
            if max(state.pose.pose.position.z for state in states) < 0.3:
                return self.new_flight()
        where = states[-1].pose.pose.position
        raise AssertionError(f"it neither hovers nor has it landed: {where}")

    def new_flight(self) -> None:
        self.kill("sim")
        self.start("sim")
        self.world.wait_for(TRUE_ODOMETRY, lambda m: m.pose.pose.position.z < 0.3, 60.0)
        assert max(state.pose.pose.position.z for state in self.wait(3.0)) < 0.3, "uncommanded"
        obeyed, why = call_trigger(self.world, "mission", "takeoff")
        assert obeyed or "it flies" in why, why  # an answer may be lost, see `call`
        self.rise()

    def rise(self) -> None:
        """Wait for the hover. A late machine may lose its position and land: take off again."""
        begin = asked = time.monotonic()
        while self.height() < 1.4:
            now = time.monotonic()
            with in_time():
                assert now < begin + 90.0, f"at {self.height():.2f} m\n{self.reports()}"
            if now > asked + 5.0 and self.phase() in (MissionStatus.IDLE, MissionStatus.LANDED):
                call_trigger(self.world, "mission", "takeoff")
                asked = now
            time.sleep(0.1)
        self.settle()

    def height(self) -> float:
        """Return the true height [m]; before the first message on the ground."""
        self.world.hear()
        heard = self.world.heard[TRUE_ODOMETRY.name]
        return float(heard[-1].pose.pose.position.z) if heard else 0.0

    def phase(self) -> int:
        """Return the mission's phase."""
        self.world.hear()
        heard = self.world.heard[MISSION_STATUS.name]
        return int(heard[-1].phase) if heard else MissionStatus.IDLE

    def truth(self) -> Any:
        self.world.hear()
        return self.world.heard[TRUE_ODOMETRY.name][-1]

    def reports(self) -> str:
        """Return the reports of the nodes since the last `settle`, and the mission's phase."""
        self.world.hear()
        lines = []
        for message in self.world.heard[DIAGNOSTICS.name][self.mark :]:
            when_s = to_ns(message.header.stamp) * 1e-9
            lines += [f"{when_s:.2f} s {s.name}: {s.message}" for s in message.status if s.message]
        return "\n".join([*lines, str(self.world.heard[MISSION_STATUS.name][-1:])])

    def flown_s(self) -> float:
        return to_ns(self.truth().header.stamp) * 1e-9

    def wait(self, seconds: float) -> list[Any]:
        """Let simulated time pass; return the true states in it."""
        self.world.hear()
        begin = len(self.world.heard[TRUE_ODOMETRY.name])
        until = self.flown_s() + seconds
        end = time.monotonic() + 60.0
        while self.flown_s() < until:
            assert time.monotonic() < end, "the simulation stands still"
            time.sleep(0.01)
        return self.world.heard[TRUE_ODOMETRY.name][begin:]

    def settle(self) -> None:
        """Wait until the vehicle hovers as before."""
        calm_since = None
        end = time.monotonic() + 40.0
        while True:
            state = self.truth()
            where, speed = state.pose.pose.position, state.twist.twist.linear
            off = math.hypot(where.x, where.y, where.z - HEIGHT)
            fast = math.hypot(speed.x, speed.y, speed.z)
            now = self.flown_s()
            if off > 0.15 or fast > 0.15:
                calm_since = None
            elif calm_since is None:
                calm_since = now
            elif now - calm_since > 0.3:
                self.mark = len(self.world.heard[DIAGNOSTICS.name])
                return
            with in_time():
                assert time.monotonic() < end, f"no hover: {off:.2f} m off, {fast:.2f} m/s"
            time.sleep(0.01)

    def report(self, node: str, key: str, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Wait until a node has reported a fault since the last `settle`."""
        try:
            self.world.wait_for_fault(node, key, since=self.mark, meanwhile=meanwhile)
        except NotInTime as error:
            words = self.nodes[node].output.splitlines()[-5:]
            raise NotInTime(f"{node}: no {key}; its last words: {words}") from error


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Suite]:
    """Start the suite and fly it to its hover; end all of it in the end."""
    folder = tmp_path_factory.mktemp("suite")
    file = folder / "hover.yaml"
    file.write_text(HOVER)
    with ros_domain(), contextlib.closing(Counterpart()) as world:
        made = Suite(world=world, nodes={}, folder=folder, file=file, mark=0)
        world.subscribe(TRUE_ODOMETRY, DIAGNOSTICS, MISSION_STATUS)
        try:
            for name in NODES:
                made.start(name)
            made.rise()
            yield made
        finally:
            codes = {name: node.end() for name, node in made.nodes.items()}
            for node in made.nodes.values():
                node.close()
    assert set(codes.values()) == {0}, codes


@pytest.fixture
def suite(flight: Suite, request: pytest.FixtureRequest) -> Iterator[Suite]:
    flight.settle_or_begin_again()
    yield flight
    if failed(request.node):
        sys.stdout.write(flight.reports())  # pytest shows it with the failure


def lowest(states: list[Any]) -> float:
    return min(state.pose.pose.position.z for state in states)


def steepest(states: list[Any]) -> float:
    """Largest tilt [rad] in some states."""
    tilts = []
    for state in states:
        q = state.pose.pose.orientation
        tilts.append(math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (q.x**2 + q.y**2)))))
    return max(tilts)


def across(states: list[Any]) -> float:
    """Largest horizontal distance from the hover's place [m]."""
    places = [state.pose.pose.position for state in states]
    return max(math.hypot(p.x, p.y) for p in places)


def furthest(states: list[Any]) -> float:
    """Largest distance from the hover's place [m]."""
    places = [state.pose.pose.position for state in states]
    return max(math.hypot(p.x, p.y, p.z - HEIGHT) for p in places)


# --- two publishers -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spec", "make", "node"),
    [(SETPOINT, PositionSetpoint, "controller"), (ROTOR_COMMAND, RotorSpeeds, "sim")],
    ids=lambda value: value.name if isinstance(value, TopicSpec) else "",
)
def test_second_publisher(
    suite: Suite, spec: TopicSpec, make: Callable[[], Any], node: str
) -> None:
    """Somebody else sends 2 m to the side, or zeros: it must not be obeyed."""
    suite.world.meet(spec)
    begin = len(suite.world.heard[TRUE_ODOMETRY.name])

    def disturb() -> None:
        message = make()
        message.header.stamp = to_time(round(suite.flown_s() * 1e9))
        message.header.frame_id = "base_link" if spec is ROTOR_COMMAND else "map"
        if spec is SETPOINT:
            message.phase, message.position.x, message.position.z = 2, 2.0, HEIGHT
        suite.world.publish(spec, message)
        time.sleep(0.01)

    suite.report(node, f"second_publisher.{spec.name.lstrip('/')}", disturb)
    for _ in range(30):
        disturb()
    states = suite.world.heard[TRUE_ODOMETRY.name][begin:]
    assert across(states) < 0.3, "it went where the second one said"
    with in_time():
        # it brakes to hold where a node sees the second one late; obeyed, it leans by 0.6 rad
        assert steepest(states) < 0.5
        assert spec is ROTOR_COMMAND or lowest(states) > HEIGHT - 0.2


# --- a node dies ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "observer", "key"),
    [
        ("estimator", "controller", "blind"),
        ("controller", "sim", "failsafe"),
        ("reaction", "controller", "setpoint_silent"),
        ("detector", "reaction", "detector_silent"),
        ("mission", "reaction", "mission_silent"),
    ],
)
def test_node_killed_and_restarted(suite: Suite, name: str, observer: str, key: str) -> None:
    begin = len(suite.world.heard[TRUE_ODOMETRY.name])
    suite.kill(name)
    suite.report(observer, key)
    suite.world.hear()
    restarted = len(suite.world.heard[DIAGNOSTICS.name])
    suite.start(name)
    suite.wait(1.0)
    states = suite.world.heard[TRUE_ODOMETRY.name][begin:]
    suite.world.wait_for(
        DIAGNOSTICS, lambda m: any(status.name == name for status in m.status), since=restarted
    )
    with in_time():
        assert steepest(states) < 0.4
        assert across(states) < 0.6
        # Fast DDS's shared memory may hold up a publisher for 333 ms where a process joins
        # (eProsima/Fast-DDS issue 6535): without a position for so long, it descends.
        knew_position = "position_lost" not in suite.reports()
        if name in ("reaction", "detector", "mission") and knew_position:
            assert lowest(states) > HEIGHT - 0.2, "it holds"


def test_simulator_killed_and_restarted(suite: Suite) -> None:
    suite.kill("sim")
    suite.report("controller", "clock_silent")
    suite.new_flight()


# --- the table ------------------------------------------------------------------------------


def test_the_table_in_the_docs_has_a_test_for_each_row() -> None:
    page = (ROOT / "docs" / "faults.md").read_text()
    rows = re.findall(r"^\| .* \| `(test_\w+)` \|$", page, re.MULTILINE)
    here = {name for name in globals() if name.startswith("test_")}
    here -= {"test_the_table_in_the_docs_has_a_test_for_each_row"}
    elsewhere = set(rows) - here
    assert here <= set(rows), "tested, but not in the table"
    others = "".join(p.read_text() for p in ROOT.glob("t*/**/test_*.py"))
    assert all(f"def {name}(" in others for name in elsewhere), "in the table, but not tested"

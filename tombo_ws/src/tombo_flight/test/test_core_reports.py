"""A core's answer to bad and missing messages, and to two publishers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import nan
from typing import Any

import numpy as np
import pytest

from core_calls import take_over
from tombo_bag.message_codec import dataclass_of
from tombo_bag.topics import TOPICS
from tombo_control.controller_core import ControllerCore
from tombo_dynamics.messages import Phase, neutral
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_flight.scenario import load_scenario
from tombo_flight.wiring import core_of
from tombo_sim.wiring import CORES

KINDS = {kind.name: kind for kind in CORES}
POSE, IMU, ODOMETRY, BIAS = "/mocap/pose", "/imu/data_raw", "/odometry", "/estimator/status"
MISSION, SETPOINT, COLLISION = "/mission/setpoint", "/setpoint", "/collision_event"
TICKS = {POSE: 33, IMU: 1, ODOMETRY: 4, "/detector/status": 33}
"""Between two messages; of other topics 20."""
ONCE = ("/goal_pose", COLLISION, "/contact_event")
COUNTS = ("/detector/status", "/estimator/status")
"""Topics that count refused messages."""
BEGIN_TICK = 1200
"""Ticks after which every core does what it does in flight."""
MS = 1_000_000
NOWHERE = np.array([0.0, 0.0, nan])


class Hovering:
    """A core of a vehicle that rests level at the origin, in the phase of approach."""

    def __init__(self, name: str) -> None:
        self.core = core_of(KINDS[name], load_scenario("hover"))
        if isinstance(self.core, ControllerCore):
            take_over(self.core)
        self.tick = 0
        self.events: set[str] = set()
        self.published: list[tuple[str, Any]] = []

    @property
    def now_ns(self) -> int:
        return EPOCH_NS + self.tick * TICK_NS

    def message(self, topic: str, **changed: Any) -> Any:
        message = neutral(dataclass_of(TOPICS[topic].typename), self.now_ns)
        phase = {"phase": int(Phase.APPROACH)} if hasattr(message, "phase") else {}
        return replace(message, **{**phase, **changed})

    def send(self, topic: str, **changed: Any) -> None:
        self.core.on(topic, self.message(topic, **changed), self.now_ns)
        self.events |= {key for key, _ in self.core.health.take_events()}

    def run(self, ticks: int, *, without: Sequence[str] = ()) -> list[tuple[str, Any]]:
        """Go on with good messages; return the published messages."""
        begin = len(self.published)
        for _ in range(ticks):
            self.tick += 1
            for topic in self.core.inputs:
                if topic not in (*ONCE, *without) and self.tick % TICKS.get(topic, 20) == 0:
                    self.send(topic)
            if self.now_ns % self.core.period_ns == 0 or self.core.steps_on_messages:
                self.published += self.core.step(self.now_ns)
        return self.published[begin:]


def same(one: Any, other: Any) -> bool:
    return all(np.array_equal(value, vars(other)[name]) for name, value in vars(one).items())


@pytest.mark.parametrize(
    ("name", "topic", "changed", "age_ms", "key"),
    [
        ("detector", POSE, {"frame_id": "odom"}, 0, "pose_wrong_frame"),
        ("detector", POSE, {"position": NOWHERE}, 0, "pose_not_finite"),
        ("detector", POSE, {}, -1000, "pose_future"),
        ("detector", POSE, {}, 40, "pose_out_of_order"),
        ("estimator", POSE, {"frame_id": "odom"}, 0, "pose_wrong_frame"),
        ("estimator", POSE, {"position": NOWHERE}, 0, "pose_not_finite"),
        ("estimator", POSE, {"attitude": np.array([0.0, 0.0, 0.0, 0.5])}, 0, "pose_not_unit"),
        ("estimator", POSE, {}, -1000, "pose_future"),
        ("estimator", POSE, {}, 1000, "pose_late"),
        ("estimator", POSE, {}, 100, "pose_out_of_order"),
        ("estimator", POSE, {"position": np.array([2.0, 0.0, 0.0])}, 0, "pose_jump"),
        ("estimator", IMU, {"gyro": NOWHERE}, 0, "imu_not_finite"),
        ("controller", IMU, {"gyro": NOWHERE}, 0, "imu_not_finite"),
        ("controller", ODOMETRY, {"position": NOWHERE}, 0, "odometry_refused"),
        ("controller", ODOMETRY, {}, -1000, "odometry_refused"),
        ("controller", BIAS, {"gyro_bias": NOWHERE}, 0, "estimator_status_refused"),
        ("controller", SETPOINT, {"position": NOWHERE}, 0, "setpoint_refused"),
        ("mission", ODOMETRY, {"position": NOWHERE}, 0, "odometry_not_finite"),
        ("mission", "/goal_pose", {"frame_id": "odom"}, 0, "goal_refused"),
        ("reaction", ODOMETRY, {"position": NOWHERE}, 0, "odometry_not_finite"),
        ("reaction", MISSION, {"position": NOWHERE}, 0, "mission_not_finite"),
        ("reaction", COLLISION, {"contact_position": NOWHERE}, 0, "event_not_finite"),
        ("reaction", COLLISION, {"flight_direction": np.zeros(3)}, 0, "event_not_unit"),
        ("reaction", COLLISION, {"frame_id": "odom"}, 0, "event_wrong_frame"),
        ("reaction", COLLISION, {"contact_position": np.full(3, 9.0)}, 0, "event_elsewhere"),
        ("reaction", COLLISION, {}, -1000, "event_future"),
        ("reaction", COLLISION, {}, 5000, "event_stale"),
    ],
)
def test_a_bad_message_is_reported_and_changes_nothing(name, topic, changed, age_ms, key):
    disturbed, other = Hovering(name), Hovering(name)
    for flight in (disturbed, other):
        flight.run(BEGIN_TICK)
    assert key not in disturbed.events
    disturbed.send(topic, stamp_ns=disturbed.now_ns - age_ms * MS, **changed)
    assert key in disturbed.events

    published, undisturbed = (
        [message for at, message in f.run(100) if at not in COUNTS] for f in (disturbed, other)
    )
    assert all(same(*pair) for pair in zip(published, undisturbed, strict=True))
    assert published or name == "detector"


@pytest.mark.parametrize(
    ("name", "topics", "silent_ms", "key"),
    [
        ("detector", (POSE,), 140, "mocap_silent"),
        ("estimator", (POSE,), 600, "mocap_silent"),
        ("estimator", (IMU,), 200, "imu_silent"),
        ("controller", (IMU,), 200, "imu_silent"),
        ("controller", (ODOMETRY, BIAS), 200, "blind"),
        ("controller", (SETPOINT,), 600, "setpoint_silent"),
        ("mission", (ODOMETRY,), 600, "estimate_silent"),
        ("reaction", ("/detector/status",), 600, "detector_silent"),
        ("reaction", (MISSION,), 600, "mission_silent"),
        ("reaction", (POSE,), 600, "blind"),
    ],
)
def test_silence_is_a_fault_until_it_is_over(name, topics, silent_ms, key):
    flight = Hovering(name)
    flight.run(BEGIN_TICK)
    assert key not in flight.core.health.faults
    flight.run(silent_ms, without=topics)
    assert key in flight.core.health.faults
    if key != "blind" or name != "controller":  # that one goes down
        flight.run(BEGIN_TICK)
        assert key not in flight.core.health.faults


def test_a_pose_that_comes_late_is_used_and_reported():
    flight = Hovering("detector")
    flight.run(BEGIN_TICK, without=(POSE,))
    flight.send(POSE, stamp_ns=flight.now_ns - 150 * MS)
    assert flight.events == {"mocap_late"}
    assert not flight.core.memory.refused.any()


@pytest.mark.parametrize(
    ("name", "topic"),
    [
        ("detector", POSE),
        ("estimator", POSE),
        ("estimator", IMU),
        ("controller", IMU),
        ("controller", ODOMETRY),
        ("controller", SETPOINT),
    ],
)
def test_of_two_publishers_nobody_is_believed(name, topic):
    flight = Hovering(name)
    flight.run(BEGIN_TICK)
    memory, moved = flight.core.memory, {} if topic == IMU else {"position": np.full(3, 0.01)}
    if name == "detector":  # all else counts refused poses
        memory = memory.detector
    before = memory.tobytes()
    flight.tick += 1
    flight.core.set_multiple_publishers(topic, several=True)
    flight.send(topic, **moved)
    assert memory.tobytes() == before
    assert flight.events == ({"pose_two_publishers"} if name == "detector" else set())
    flight.core.set_multiple_publishers(topic, several=False)
    flight.send(topic, **moved)
    assert memory.tobytes() != before


def test_after_a_restart_of_the_simulation_a_set_point_of_before_lifts_nothing_off():
    flight = Hovering("controller")
    flight.core.clock_slack_ns = 20 * MS
    assert min(dict(flight.run(BEGIN_TICK))["/rotor_command"].speed) > 300.0
    old_ns, flight.tick = flight.now_ns, flight.tick - 5000
    flight.run(60, without=(SETPOINT,))
    flight.send(SETPOINT, stamp_ns=old_ns)
    assert "setpoint_refused" in flight.events
    commands = dict(flight.run(60, without=(SETPOINT,)))
    assert not any(commands["/rotor_command"].speed)

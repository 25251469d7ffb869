"""The reaction over DDS, stepped by /clock: in line between mission and controller."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from reports import heard

from ros_bench import vector
from tombo_bag.topics import (
    CLOCK,
    COLLISION_EVENT,
    DETECTOR_STATUS,
    DIAGNOSTICS,
    MARKERS,
    MISSION_SETPOINT,
    MOCAP_POSE,
    ODOMETRY,
    REACTION_STATUS,
    SETPOINT,
)
from tombo_msgs.msg import (
    CollisionEvent,
    DetectorStatus,
    MissionStatus,
    PositionSetpoint,
    ReactionStatus,
)
from tombo_ros.conversion import array, point, to_time

MS = 1_000_000
X_C, X_R = np.array([1.7, 0.0, 2.0]), np.array([0.9, 0.0, 2.0])


class Flight:
    """Everything around the reaction; `step` is 20 ms of it."""

    def __init__(self, world, start):
        self.world = world
        world.now_ns = 1_763_700_000_123_456_789
        world.subscribe(SETPOINT, REACTION_STATUS, MARKERS, DIAGNOSTICS)
        self.node = start("tombo_collision.reaction_node", "-p", "use_sim_time:=true")
        world.meet(CLOCK, MISSION_SETPOINT, ODOMETRY, MOCAP_POSE, DETECTOR_STATUS)
        world.meet(COLLISION_EVENT, SETPOINT, REACTION_STATUS, MARKERS, DIAGNOSTICS)
        self.place = np.array([1.6, 0.0, 2.0])
        self.mission_setpoint = np.array([1.65, 0.0, 2.0])
        self.phase = MissionStatus.APPROACH
        self.detector = True

    def setpoint(self):
        message = PositionSetpoint(yaw=0.3, phase=self.phase)
        message.header.stamp, message.header.frame_id = to_time(self.world.now_ns), "map"
        message.position, message.velocity = point(self.mission_setpoint), vector([0.7, 0.0, 0.0])
        message.acceleration = vector([0.1, 0.2, 0.3])
        return message

    def step(self):
        world = self.world
        world.tick(20 * MS)
        stamp = to_time(world.now_ns)
        odometry = Odometry(child_frame_id="base_link")
        odometry.header.stamp, odometry.header.frame_id = stamp, "map"
        odometry.pose.pose.position = point(self.place)
        world.publish(ODOMETRY, odometry)
        world.publish(MOCAP_POSE, PoseStamped())
        if self.detector:
            world.publish(DETECTOR_STATUS, DetectorStatus())
        world.publish(MISSION_SETPOINT, self.setpoint())

    def wait(self, spec, condition):
        """Return the first message from now on that meets a condition; time goes on."""
        self.world.hear()
        since = len(self.world.heard[spec.name])
        return heard(self.world, spec, condition, since, self.step)

    def collision(self, age_ms=30):
        event = CollisionEvent(trigger=CollisionEvent.TRIGGER_INNOVATION, count=1)
        event.header.stamp = to_time(self.world.now_ns - age_ms * MS)
        event.header.frame_id = "map"
        event.contact_position = point(X_C)
        event.flight_direction = vector([1.0, 0.0, 0.0])
        return event


def test_passes_set_points_on_and_answers_a_collision_at_once(world, start):
    flight = Flight(world, start)
    said = flight.wait(SETPOINT, lambda m: True)
    assert said.header.frame_id == "map"
    sent = flight.setpoint()
    for name in ("position", "velocity", "acceleration", "yaw", "phase"):
        assert getattr(said, name) == getattr(sent, name), name
    status = heard(world, REACTION_STATUS, lambda m: True)
    assert status.state == ReactionStatus.IDLE
    assert math.isnan(status.x_r.x) and math.isnan(status.x_c.y) and math.isnan(status.n_r.z)

    # no further wish, no tick of the clock: the event alone
    world.publish(COLLISION_EVENT, flight.collision())
    said = heard(world, SETPOINT, lambda m: m.phase == MissionStatus.REACT)
    assert array(said.position) == pytest.approx(X_R)
    assert not array(said.velocity).any()
    status = heard(world, REACTION_STATUS, lambda m: m.state == ReactionStatus.REACTING)
    assert array(status.x_c) == pytest.approx(X_C)
    assert array(status.x_r) == pytest.approx(X_R)
    assert array(status.n_r) == pytest.approx([-1.0, 0.0, 0.0])
    assert status.collisions == 1
    x_r = lambda array_: array_.markers[0].ns == "x_r"  # noqa: E731
    heard(world, MARKERS, x_r)
    places = {m.ns: array(m.pose.position) for a in world.heard[MARKERS.name] for m in a.markers}
    assert places["x_c"] == pytest.approx(X_C)
    assert places["x_r"] == pytest.approx(X_R)

    # it stays until the mission follows; another one does not take it away
    flight.place, before = np.array([1.2, 0.3, 1.6]), len(world.heard[SETPOINT.name])
    for _ in range(5):
        flight.wait(SETPOINT, lambda m: True)
    assert all(
        array(m.position) == pytest.approx(X_R) for m in world.heard[SETPOINT.name][before:]
    )
    flight.mission_setpoint, flight.phase = X_R, MissionStatus.HOLD
    flight.wait(SETPOINT, lambda m: m.phase == MissionStatus.HOLD)
    assert flight.node.end() == 0

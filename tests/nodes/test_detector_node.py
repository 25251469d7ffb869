"""The detector over DDS, stepped by /clock: poses in, a collision with its stamps out."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from reports import heard, told

from tombo_bag.topics import CLOCK, COLLISION_EVENT, DETECTOR_STATUS, DIAGNOSTICS, MOCAP_POSE
from tombo_msgs.msg import CollisionEvent
from tombo_ros.conversion import array, point, to_ns, to_time
from tombo_ros.topic import TopicPublisher

MS = 1_000_000
PERIOD_NS, LATENCY_NS = 33 * MS, 40 * MS
SPEED = 0.7


def pose(stamp_ns, place, frame="map"):
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), frame
    message.pose.position = point(place)
    return message


class Flight:
    """Poses of a flight along +x at 2 m; `hit` turns it back."""

    def __init__(self, world, start, *arguments):
        self.world = world
        world.subscribe(COLLISION_EVENT, DETECTOR_STATUS, DIAGNOSTICS)
        self.node = start("tombo_collision.detector_node", "-p", "use_sim_time:=true", *arguments)
        world.meet(MOCAP_POSE, CLOCK, COLLISION_EVENT, DETECTOR_STATUS, DIAGNOSTICS)
        self.place = np.array([0.0, 0.0, 0.18])
        self.velocity = np.zeros(3)
        world.now_ns = 1_763_700_000_123_456_789
        heard(world, DETECTOR_STATUS, meanwhile=self._publish)
        self.place = np.array([0.0, 0.0, 2.0])
        world.tick(1000 * MS)
        self.velocity = np.array([SPEED, 0.0, 0.0])

    @property
    def stamp_ns(self):
        return self.world.now_ns - LATENCY_NS

    def _publish(self, message=None):
        """Move the clock on by a period and publish a pose."""
        self.world.tick(PERIOD_NS)
        self.place = self.place + self.velocity * PERIOD_NS * 1e-9
        sent = pose(self.stamp_ns, self.place) if message is None else message
        self.world.publish(MOCAP_POSE, sent)
        return sent

    def send(self, message=None):
        """Publish a pose and return the detector's word on it."""
        sent = self._publish(message)
        since = len(self.world.heard[DETECTOR_STATUS.name])
        same = lambda status: status.header.stamp == sent.header.stamp  # noqa: E731
        return heard(self.world, DETECTOR_STATUS, same, since)

    def fly(self, poses):
        return [self.send() for _ in range(poses)]


def test_a_strike_is_told_with_stamp_place_and_direction(world, start):
    flight = Flight(world, start)
    flight.fly(20)
    contact_ns, x_c = flight.stamp_ns, flight.place
    flight.velocity = np.array([-0.8, 0.0, 0.0])
    statuses = flight.fly(3)
    (event,) = world.heard[COLLISION_EVENT.name]
    stamps = [to_ns(status.header.stamp) for status in statuses]
    assert to_ns(event.header.stamp) in stamps
    assert event.header.frame_id == "map"
    assert event.trigger == CollisionEvent.TRIGGER_INNOVATION
    assert to_ns(event.contact_stamp) == pytest.approx(contact_ns + PERIOD_NS / 2, abs=1000)
    assert array(event.contact_position) == pytest.approx(x_c, abs=0.03)
    assert array(event.flight_direction) == pytest.approx([1.0, 0.0, 0.0], abs=0.02)
    fired = statuses[stamps.index(to_ns(event.header.stamp))]
    assert event.statistic == fired.statistic > fired.threshold == 60.0
    assert event.confidence > 0.9
    assert event.count == 1
    assert statuses[-1].poses >= 24
    assert statuses[-1].rejected == statuses[0].rejected
    assert flight.node.end() == 0


def test_bad_poses_are_refused_counted_and_told_and_it_goes_on(world, start):
    flight = Flight(world, start)
    refused = flight.fly(14)[-1].rejected
    there = flight.place
    hour_ns = 3600 * 1000 * MS
    bad = {
        "pose_wrong_frame": lambda: pose(world.now_ns, there, "odom"),
        "pose_not_finite": lambda: pose(world.now_ns, [math.nan, 0.0, 2.0]),
        "pose_future": lambda: pose(world.now_ns + hour_ns, there),
        "pose_late": lambda: pose(world.now_ns - hour_ns, there),
        "pose_jump": lambda: pose(world.now_ns, there + np.array([0.5, 0.5, 0.0])),
        "pose_out_of_order": lambda: pose(flight.stamp_ns, there),
    }
    for count, (fault, made) in enumerate(bad.items(), 1):
        status = flight.send(made())
        assert (status.rejected - refused, status.statistic) == (count, 0.0)
        assert told(world, "detector", fault)
        flight.fly(1)
    flight.velocity = np.array([-0.8, 0.0, 0.0])
    flight.fly(3)
    assert len(world.heard[COLLISION_EVENT.name]) == 1
    # mocap silent
    world.tick(130 * MS)
    assert "no mocap poses" in told(world, "detector", "mocap_silent")


def test_poses_of_two_motion_captures_are_not_mixed(world, start):
    flight = Flight(world, start)
    flight.fly(14)
    other = TopicPublisher(world.node, MOCAP_POSE)
    for _ in range(10):  # it is 3 cm off: a kick, if the two were one
        flight.fly(1)
        other.publish(pose(flight.stamp_ns + 10 * MS, flight.place + np.array([0.0, 0.03, 0.0])))
        flight.fly(1)
    assert "which is true is unknown" in told(world, "detector", "pose_two_publishers")
    refused = flight.fly(1)[-1].rejected
    assert flight.fly(1)[-1].rejected == refused + 1

"""The estimator as a node: what was flown in, odometry out."""

from __future__ import annotations

import time

import numpy as np
import pytest

from in_time import in_time

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseStamped
from parameter_calls import set_parameters
from reports import heard, told
from sensor_msgs.msg import Imu

from lockstep_bench import EPOCH_NS, calm, hover_at, hovering
from ros_bench import vector
from tombo_bag.topics import (
    CLOCK,
    DIAGNOSTICS,
    ESTIMATOR_STATUS,
    IMU,
    MISSION_STATUS,
    MOCAP_POSE,
    ODOMETRY,
)
from tombo_dynamics.records import numbers
from tombo_dynamics.rotation import rotate_vector
from tombo_msgs.msg import MissionStatus
from tombo_ros.conversion import array, point, quaternion, to_ns, to_time

_MS = 1_000_000


class _Recorded:
    """A flight at 0.5 m/s: IMU, poses and truth of each tick, given to the node one by one."""

    def __init__(self, world) -> None:
        self.world = world
        self.flight = hovering(calm())
        begin = self.flight.simulator.tick * 1e-3
        self.flight.steer = lambda t: hover_at(0.5 * (t - begin), 0.0, 2.0, (0.5, 0.0, 0.0))
        self.flight.fly(2.0)
        self.truth: dict[int, np.ndarray] = {}
        world.now_ns = self.flight.now_ns

    def play(self, seconds: float) -> None:
        """Fly on, and send what the sensors say."""
        for _ in range(round(seconds * 1000)):
            simulator = self.flight.simulator
            now = self.flight.now_ns
            self.truth[now] = numbers(simulator.plant.state)
            imu = Imu()
            imu.header.stamp, imu.header.frame_id = to_time(now), "base_link"
            imu.angular_velocity = vector(simulator.imu[:3])
            imu.linear_acceleration = vector(simulator.imu[3:])
            for sample in simulator.arrived:
                stamp = EPOCH_NS + sample.captured * _MS
                self.world.publish(MOCAP_POSE, pose(stamp, sample.pose))
            self.world.publish(IMU, imu)
            self.world.tick(now - self.world.now_ns)
            self.flight.step()
            self.wait(now)

    def wait(self, now: int) -> None:
        """Leave the node no more than 40 ms behind, once it speaks."""
        end = time.monotonic() + 60.0
        spoken = self.world.heard[ODOMETRY.name]
        while time.monotonic() < end:
            self.world.hear()
            if not spoken or to_ns(spoken[-1].header.stamp) > now - 40 * _MS:
                break
            time.sleep(0.0005)
        time.sleep(0.0002 if spoken else 0.002)


def pose(stamp_ns: int, values: np.ndarray, frame: str = "map") -> PoseStamped:
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), frame
    message.pose.position = point(values[:3])
    message.pose.orientation = quaternion(values[3:])
    return message


@pytest.mark.real_time
def test_odometry_is_the_flight_and_bad_poses_are_told(world, start):
    world.subscribe(ODOMETRY, ESTIMATOR_STATUS, DIAGNOSTICS)
    node = start("tombo_control.estimator_node", "-p", "use_sim_time:=true")
    recorded = _Recorded(world)
    world.meet(IMU, MOCAP_POSE, MISSION_STATUS, CLOCK, ODOMETRY, ESTIMATOR_STATUS)
    world.publish(MISSION_STATUS, MissionStatus(phase=MissionStatus.HOVER))
    recorded.play(1.5)
    last = recorded.flight.now_ns
    heard(world, ODOMETRY, lambda m: to_ns(m.header.stamp) > last - 10 * _MS)

    found = world.heard[ODOMETRY.name]
    stamps = [to_ns(message.header.stamp) for message in found]
    assert all(stamp % (4 * _MS) == 0 and stamp in recorded.truth for stamp in stamps)
    with in_time():  # 250 Hz
        assert np.mean(np.diff(stamps)) == pytest.approx(4 * _MS, rel=0.1)
    assert {(m.header.frame_id, m.child_frame_id) for m in found} == {("map", "base_link")}
    for message, stamp in list(zip(found, stamps, strict=True))[-100:]:
        truth = recorded.truth[stamp]
        q = array(message.pose.pose.orientation)
        assert np.linalg.norm(array(message.pose.pose.position) - truth[:3]) < 0.02
        assert abs(q @ truth[6:10]) > 0.9998
        velocity = rotate_vector(q, array(message.twist.twist.linear))
        assert np.linalg.norm(velocity - truth[3:6]) < 0.1
    status = world.heard[ESTIMATOR_STATUS.name][-1]
    assert status.initialised
    assert status.poses > 30
    with in_time():
        assert status.rejected == 0
        assert 0 < last - to_ns(status.pose_stamp) < 80 * _MS

    # each with a stamp newer than the last good pose, so that nothing else is wrong about it
    here = np.concatenate([recorded.flight.position, [0.0, 0.0, 0.0, 1.0]])
    away, broken = np.add(here, [2, 0, 0, 0, 0, 0, 0]), here * np.nan
    for fault, message in (
        ("pose_wrong_frame", pose(last, here, "odom")),
        ("pose_not_finite", pose(last, broken)),
        ("pose_not_unit", pose(last, here * [1, 1, 1, 1, 1, 1, 0.5])),
        ("pose_future", pose(last + 10**9, here)),
        ("pose_late", pose(last - 10**9, here)),
        ("pose_out_of_order", pose(last - 100 * _MS, here)),
        ("pose_jump", pose(last - _MS, away)),
    ):
        since = len(world.heard[DIAGNOSTICS.name])
        world.publish(MOCAP_POSE, message)
        assert told(world, "estimator", fault, since)

    # a wider limit set in flight: the same pose is no jump any more
    assert set_parameters(world, "estimator", estimator__jump_min=50.0) == [(True, "")]
    recorded.play(0.3)
    heard(
        world,
        ESTIMATOR_STATUS,
        lambda m: to_ns(m.header.stamp) > last + 250 * _MS,
        meanwhile=lambda: recorded.play(0.02),
    )
    after = world.heard[ESTIMATOR_STATUS.name][-1]
    assert after.rejected >= status.rejected + 7
    assert after.poses > status.poses
    stamp = recorded.flight.now_ns - 2 * _MS
    world.publish(MOCAP_POSE, pose(stamp, np.add(here, [3, 0, 0, 0, 0, 0, 0])))
    heard(
        world,
        ODOMETRY,
        lambda m: m.pose.pose.position.x > recorded.flight.position[0] + 0.3,
        since=len(world.heard[ODOMETRY.name]),
        meanwhile=lambda: recorded.play(0.02),
    )
    assert node.end() == 0

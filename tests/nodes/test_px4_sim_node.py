"""The simulated PX4 as a node: MAVLink on one side, the motion capture over ROS on the other."""

from __future__ import annotations

import time

import numpy as np
import pytest

from in_time import in_time

pytest.importorskip("rclpy")

from tombo_bag.topics import IMU, MARKERS, MOCAP_POSE, ROTOR_COMMAND, TRUE_ODOMETRY
from tombo_flight.suite.px4_connection import free_udp_port
from tombo_px4.bridge.session import VehicleCommand
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.messages import MessageTarget, read_parameter
from tombo_ros.conversion import array, to_ns

NODE = "tombo_px4.px4_sim_node"
VEHICLE = MessageTarget(1, 1)
_COMPILES_S = 300.0
_ARM, _DENIED = 400, 1
MS = 1_000_000


@pytest.fixture
def link():
    found = Link(
        f"udpin://127.0.0.1:{free_udp_port()}", system=245, component=191, clock=time.time_ns
    )
    yield found
    found.close()


def urls(link: Link) -> tuple[str, ...]:
    """Parameters that lead the node to a link, and to no ground station."""
    port = link.url.rpartition(":")[2]
    return ("-p", f"onboard_url:=udpout://127.0.0.1:{port}", "-p", "ground_url:=''")


def wait_for(
    link: Link, kind: str, condition=lambda message: True, patience_s=60.0, meanwhile=None
):
    """The first message of a kind that meets a condition."""
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        link.wait(0.05)
        for received in link.receive():
            if received.message.get_type() == kind and condition(received.message):
                return received
        if meanwhile is not None:
            meanwhile()
    raise AssertionError(f"no such {kind}")


@pytest.mark.real_time
def test_mavlink_on_one_side_and_mocap_on_the_other(world, start, link):
    world.subscribe(MOCAP_POSE, TRUE_ODOMETRY, MARKERS, IMU)
    obstacle = ("-p", "obstacle.radius:=0.25", "-p", "obstacle.x:=2.0", "-p", "obstacle.top:=2.6")
    node = start(NODE, *urls(link), *obstacle, "-p", "mocap_rate:=100.0")
    beat = wait_for(link, "HEARTBEAT", patience_s=_COMPILES_S)
    assert (beat.system, beat.component, beat.message.autopilot) == (1, 1, 12)

    world.meet(MOCAP_POSE, TRUE_ODOMETRY)
    pose = world.wait_for(MOCAP_POSE, meanwhile=link.receive)
    age_ns = time.time_ns() - to_ns(pose.header.stamp)
    assert abs(age_ns) < 60_000 * MS, "captured in another time than the system's"
    with in_time():
        assert -5 * MS < age_ns < 500 * MS
    assert pose.header.frame_id == "map"
    began_s, seen = time.monotonic(), len(world.heard[MOCAP_POSE.name])
    time.sleep(1.0)
    world.hear()
    passed_s = time.monotonic() - began_s
    stamps = [to_ns(m.header.stamp) for m in world.heard[MOCAP_POSE.name]]
    assert np.median(np.diff(stamps)) == pytest.approx(10 * MS, abs=1000)
    with in_time():
        assert len(stamps) - seen == pytest.approx(100 * passed_s, abs=25)
        assert time.time_ns() - stamps[-1] < 200 * MS
    truth = world.wait_for(TRUE_ODOMETRY, meanwhile=link.receive)
    place = array(truth.pose.pose.position)
    assert array(pose.pose.position) == pytest.approx(place, abs=0.01)
    world.wait_for(MARKERS, meanwhile=link.receive, since=0)  # the obstacle
    # PX4's own sensors and motors are PX4's business
    assert world.node.count_publishers("imu/data_raw") == 0
    assert world.node.count_subscribers(ROTOR_COMMAND.name) == 0

    # nothing but vision tells it where it is, and none has come
    link.send(read_parameter(VEHICLE, "EKF2_GPS_CTRL"))
    value = wait_for(link, "PARAM_VALUE", lambda m: m.param_id == "EKF2_GPS_CTRL")
    assert np.float32(value.message.param_value).view(np.int32) == 0
    link.send(VehicleCommand(armed=True).message(VEHICLE))
    answer = wait_for(link, "COMMAND_ACK", lambda m: m.command == _ARM)
    assert answer.message.result == _DENIED
    node.wait_for_words("PX4 says: Arming denied")
    assert node.end() == 0

"""The motion capture as a node: frames of a system or a driver become `/mocap/pose`."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from empty_loop import LATE_MS
from in_time import in_time
from natnet_server import NatNetServer

pytest.importorskip("rclpy")
pytest.importorskip("motioncapture")

from geometry_msgs.msg import TransformStamped

from tombo_bag.qos import SENSOR
from tombo_bag.topics import DIAGNOSTICS, MOCAP_POSE, TopicSpec
from tombo_ros.conversion import array, to_ns, to_time

_PATIENCE_S = 60.0
_PERIOD_S = 0.01
_ATTITUDE = [0.0, 0.0, 0.6, 0.8]


@pytest.fixture
def motive():
    server = NatNetServer(["wand", "tombo"])
    yield server
    server.close()


def optitrack(server: NatNetServer, *more: str) -> tuple[str, ...]:
    options = f"mocap.options:=port_command={server.command_port}"
    settings = ("mocap.system:=optitrack", "mocap.host:=127.0.0.1", options, *more)
    return tuple(word for setting in settings for word in ("-p", setting))


def poses(world) -> list:
    world.hear()
    return world.heard[MOCAP_POSE.name]


def send_until(send, condition) -> None:
    """Send frames at 100 Hz until a condition holds."""
    end = time.monotonic() + _PATIENCE_S
    number = 0
    while not condition():
        assert time.monotonic() < end
        number += 1
        send(number)
        time.sleep(_PERIOD_S)


def test_frames_of_optitrack_become_poses(world, start, motive):
    world.subscribe(MOCAP_POSE, DIAGNOSTICS)
    start("tombo_mocap.mocap_node", *optitrack(motive, "mocap.body:=tombo", "mocap.up:=y_up"))
    assert motive.asked.wait(_PATIENCE_S)

    def send(number: int) -> None:
        motive.send({"wand": (9.0, 9.0, 9.0, *_ATTITUDE), "tombo": (1.0, 2.0, 3.0, 0, 0, 0, 1)})

    send_until(send, lambda: len(poses(world)) > 50)
    pose = world.heard[MOCAP_POSE.name][-1]
    assert pose.header.frame_id == "map"
    place = pose.pose.position
    np.testing.assert_allclose([place.x, place.y, place.z], [1.0, -3.0, 2.0], atol=1e-6)
    assert pose.pose.orientation.w == pytest.approx(1.0)
    assert abs(time.time_ns() - to_ns(pose.header.stamp)) < 5e9

    # no camera sees the vehicle: no pose is published, and the fault names the visible bodies
    world.wait_for_fault(
        "mocap", "body_lost", "'tombo' is not seen; seen: wand",
        meanwhile=lambda: motive.send({"wand": (9.0, 9.0, 9.0, *_ATTITUDE)}, lost=["tombo"]),
    )  # fmt: skip
    count = len(poses(world))
    for _ in range(20):
        motive.send({"wand": (9.0, 9.0, 9.0, *_ATTITUDE)}, lost=["tombo"])
        time.sleep(_PERIOD_S)
    assert len(poses(world)) == count
    send_until(send, lambda: len(poses(world)) > count)


def test_each_of_several_bodies_has_the_topic_of_its_vehicle(world, start):
    """Three bodies are seen, two of them fly; one that is lost leaves the other its poses."""
    topics = [replace(MOCAP_POSE, name=f"/{name}{MOCAP_POSE.name}") for name in ("v1", "v2")]
    world.subscribe(*topics, DIAGNOSTICS)
    places = {"wand": (9.0, 9.0, 9.0), "b": (1.0, 2.0, 3.0), "a": (4.0, 5.0, 6.0)}
    server = NatNetServer(list(places))
    try:
        start("tombo_mocap.mocap_node", *optitrack(server, "mocap.bodies:=a b"))
        assert server.asked.wait(_PATIENCE_S)

        def send(*seen: str) -> None:
            lost = [name for name in places if name not in seen]
            server.send({name: (*places[name], *_ATTITUDE) for name in seen}, lost=lost)

        def heard() -> list[list]:
            world.hear()
            return [world.heard[topic.name] for topic in topics]

        send_until(lambda _: send(*places), lambda: min(map(len, heard())) > 20)
        for messages, name in zip(heard(), ("a", "b"), strict=True):
            places_heard = {tuple(array(m.pose.position)) for m in messages}
            assert places_heard == {places[name]}
        world.wait_for_fault(
            "mocap", "body_lost", "'b' is not seen", meanwhile=lambda: send("wand", "a")
        )
        before = [len(messages) for messages in heard()]
        send_until(lambda _: send("wand", "a"), lambda: len(heard()[0]) > before[0] + 20)
        assert len(heard()[1]) == before[1]
    finally:
        server.close()


def test_a_driver_s_topic_of_any_type_and_frame_becomes_poses(world, start):
    driver = TopicSpec("/vicon/tombo", "geometry_msgs/msg/TransformStamped", SENSOR, 0.0, "")
    world.subscribe(MOCAP_POSE, DIAGNOSTICS)
    start(
        "tombo_mocap.mocap_node", "-p", "mocap.system:=ros", "-p", "mocap.topic:=/vicon/tombo",
        "-p", "mocap.frame:=world", "-p", "mocap.delay:=0.01",
    )  # fmt: skip
    world.wait_for_fault("mocap", "no_frames", "nobody publishes /vicon/tombo")

    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = "world", "tombo"
    message.transform.translation.z = 1.5
    sent = []

    def send(number: int) -> None:
        sent.append(time.time_ns())
        message.header.stamp = to_time(sent[-1])
        world.publish(driver, message)

    send_until(send, lambda: len(poses(world)) > 20)
    for pose in world.heard[MOCAP_POSE.name]:
        assert pose.pose.position.z == 1.5
        assert to_ns(pose.header.stamp) + 10_000_000 in sent


def test_a_library_that_ends_is_started_again_and_says_why(world, start):
    world.subscribe(MOCAP_POSE, DIAGNOSTICS)
    start(
        "tombo_mocap.mocap_node", "-p", "mocap.system:=optitrack", "-p", "mocap.host:=nowhere",
    )  # fmt: skip
    world.wait_for_fault("mocap", "no_frames", "nothing from optitrack nowhere: ")


def test_the_live_check_sees_a_body_that_is_carried_about(world, start, motive, domain):
    world.subscribe(MOCAP_POSE)
    start("tombo_mocap.mocap_node", *optitrack(motive, "mocap.body:=tombo"))
    assert motive.asked.wait(_PATIENCE_S)
    began_s = time.monotonic()

    def send(number: int) -> None:
        at = math.sin(time.monotonic() - began_s)
        motive.send({"tombo": (at, 0.5 * at, 1.0 + 0.3 * at, 0, 0, 0, 1)})

    words = ["check", "mocap", "--seconds", "3", "--json", "--domain", str(domain)]
    command = subprocess.Popen(
        [sys.executable, "-m", "tombo_bringup.cli.main", *words], stdout=subprocess.PIPE, text=True
    )
    send_until(send, lambda: command.poll() is not None)
    assert command.stdout is not None
    result = json.load(command.stdout)
    keys = {finding["key"] for finding in result["findings"]}
    assert not keys & {"does_not_move", "millimetres", "up_axis", "markers_swapped", "clock"}
    assert result["figures"]["x_max_m"] <= 1.0
    assert result["figures"]["x_max_m"] - result["figures"]["x_min_m"] > 0.5
    assert result["source"] == "/mocap/pose"


@pytest.mark.real_time
def test_a_pose_is_passed_on_within_three_milliseconds(world, start, motive):
    world.subscribe(MOCAP_POSE)
    start("tombo_mocap.mocap_node", *optitrack(motive, "mocap.body:=tombo"))
    assert motive.asked.wait(_PATIENCE_S)
    sent: list[int] = []

    def send(number: int) -> None:
        sent.append(time.time_ns())
        motive.send({"tombo": (float(number), 0.0, 1.0, 0, 0, 0, 1)})

    arrived = []

    def enough() -> bool:
        arrived.extend(world.inputs[MOCAP_POSE.name].take())
        return len(arrived) > 1000

    send_until(send, enough)
    late_s = [
        1e-9 * (pose.received_ns - sent[round(pose.message.pose.position.x) - 1])
        for pose in arrived
    ]
    with in_time():
        assert np.median(late_s[100:]) < 0.003
        # a machine that is late by LATE_MS delays a pose as much, and counts as quiet
        assert np.percentile(late_s[100:], 99.0) < 0.003 + 1e-3 * LATE_MS

"""A lab's own bags: other types, other topics, other frames, other middleware."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from tombo_bag.columnar_cdr import encode
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_flight.replay.poses import PoseTrack
from tombo_flight.replay.run import Replay, ReplayRequest, replay_bag

POSE = "geometry_msgs/msg/PoseStamped"
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def as_message(typename: str, position: list[float], attitude: list[float]) -> dict:
    point = dict(zip("xyz", position, strict=True))
    unit = dict(zip("xyzw", attitude, strict=True))
    if typename.endswith("TransformStamped"):
        return {"transform": {"translation": point, "rotation": unit}}
    pose = {"position": point, "orientation": unit}
    return {"pose": pose if typename == POSE else {"pose": pose}}


def as_time(stamp_ns: int) -> dict[str, int]:
    sec, nanosec = divmod(stamp_ns, SECOND_NS)
    return {"sec": sec, "nanosec": nanosec}


def write(path: Path, track: PoseTrack, typename: str = POSE, topic: str = "/mocap/pose") -> Path:
    messages = []
    for stamp, frame, position, attitude in zip(
        track.stamp_ns.tolist(),
        track.frame.tolist(),
        track.position.tolist(),
        track.attitude.tolist(),
        strict=True,
    ):
        header = {"header": {"stamp": as_time(stamp), "frame_id": frame}}
        messages.append(encode(typename, {**header, **as_message(typename, position, attitude)}))
    with McapSink(path) as sink:
        channel = sink.add_channel(topic, typename)
        sink.write_columns(Columns(channel, track.arrival_ns, messages))
    return path


def stamps_s(result: Replay) -> list[float]:
    _, messages = result.published["/collision_event"]
    return [round(event.stamp_ns / 1e9, 3) for event in messages]


def events(path: Path, **request: object) -> list[float]:
    result = replay_bag(path, ReplayRequest(nodes=("detector",), **request))
    return stamps_s(result)


@pytest.mark.parametrize(
    "typename",
    [
        POSE,
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "geometry_msgs/msg/TransformStamped",
        "nav_msgs/msg/Odometry",
    ],
)
def test_every_type_of_pose_under_any_name(tmp_path, flight, typename):
    path = write(tmp_path / "lab.mcap", flight, typename, "/vicon/quad/quad")
    result = replay_bag(path, ReplayRequest())
    assert stamps_s(result) == [24.233]
    assert "poses are taken from /vicon/quad/quad, the only candidate" in result.findings
    assert any("defaults" in finding for finding in result.findings)
    metrics = result.nodes["detector"].values
    assert metrics["events_recorded"] is None
    assert metrics["false_alarms"] is None
    assert result.differences == []


def write_ros1(path: Path, track: PoseTrack) -> Path:
    t = ROS1.types
    with Ros1Writer(path) as writer:
        connection = writer.add_connection(
            "/vrpn/quad/pose", "geometry_msgs/msg/TransformStamped", typestore=ROS1
        )
        for i, (now, stamp) in enumerate(
            zip(track.arrival_ns.tolist(), track.stamp_ns.tolist(), strict=True)
        ):
            time = t["builtin_interfaces/msg/Time"](**as_time(stamp))
            position = dict(zip("xyz", track.position[i].tolist(), strict=True))
            attitude = dict(zip("xyzw", track.attitude[i].tolist(), strict=True))
            message = t["geometry_msgs/msg/TransformStamped"](
                header=t["std_msgs/msg/Header"](seq=i, stamp=time, frame_id="world"),
                child_frame_id="quad",
                transform=t["geometry_msgs/msg/Transform"](
                    translation=t["geometry_msgs/msg/Vector3"](**position),
                    rotation=t["geometry_msgs/msg/Quaternion"](**attitude),
                ),
            )
            raw = ROS1.serialize_ros1(message, "geometry_msgs/msg/TransformStamped")
            writer.write(connection, now, raw)
    return path


def test_a_ros_1_bag_with_another_frame(tmp_path, flight):
    path = write_ros1(tmp_path / "2016-05-01.bag", flight)
    refused = replay_bag(path, ReplayRequest())
    assert stamps_s(refused) == []
    assert refused.nodes["detector"].values["poses_refused"] == {"wrong_frame": 1198}
    assert any("--frame-ok 'world'" in finding for finding in refused.findings)
    assert events(path, frame_ok="world") == [24.233]


def test_several_candidates_are_listed_and_one_can_be_chosen(tmp_path, flight):
    path = tmp_path / "lab.mcap"
    message = encode(POSE, {"header": {"frame_id": "map"}, **as_message(POSE, [0, 0, 0], [0] * 4)})
    with McapSink(path) as sink:
        for topic in ("/vrpn/quad", "/vrpn/wand", "/vrpn/empty"):
            channel = sink.add_channel(topic, POSE)
            if topic != "/vrpn/empty":
                sink.write_columns(Columns(channel, np.arange(3), [message] * 3))
    with pytest.raises(InputError) as caught:
        replay_bag(path, ReplayRequest())
    assert "/vrpn/quad (3 messages), /vrpn/wand (3 messages); accepted: --map" in str(caught.value)
    result = replay_bag(path, ReplayRequest(names={"/vrpn/quad": "/mocap/pose"}))
    assert list(result.nodes) == ["detector"]


def test_two_clocks_made_one(tmp_path, flight):
    path = write(tmp_path / "lab.mcap", flight.shifted(3_200_000_000))
    late = replay_bag(path, ReplayRequest(nodes=("detector",)))
    assert late.nodes["detector"].values["poses_refused"] == {"future": 1198}
    assert any("3.2 s ahead of arrival" in finding for finding in late.findings)
    assert events(path, shift_stamps_s=-3.2) == [24.233]


def test_poses_without_stamps_are_stamped_when_they_arrived(tmp_path, flight):
    unstamped = flight.shifted(0)
    unstamped.stamp_ns[:] = 0
    path = write(tmp_path / "lab.mcap", unstamped)
    assert events(path) == []
    (found,) = events(path, stamp_on_arrival=True)
    assert found == pytest.approx(24.244, abs=0.002)


@pytest.fixture
def chatter(tmp_path):
    path = tmp_path / "chatter.mcap"
    with McapSink(path) as sink:
        channel = sink.add_channel("/chatter", "std_msgs/msg/String")
        hello = encode("std_msgs/msg/String", {"data": "hello"})
        sink.write_columns(Columns(channel, np.array([1]), [hello]))
    return path


def test_a_recording_without_poses(chatter):
    with pytest.raises(InputError) as caught:
        replay_bag(chatter, ReplayRequest())
    assert "/chatter (std_msgs/msg/String)" in str(caught.value)
    assert "--map" in str(caught.value)


def test_a_mapped_topic_of_another_type_is_refused(chatter):
    with pytest.raises(InputError, match=r"/mocap/pose has type std_msgs/msg/String; accepted"):
        replay_bag(chatter, ReplayRequest(names={"/chatter": "/mocap/pose"}))
    with pytest.raises(InputError, match="did you mean '/mocap/pose'"):
        replay_bag(chatter, ReplayRequest(names={"/chatter": "/mocap/poses"}))


@pytest.mark.slow
def test_a_recorder_on_another_clock_than_the_nodes(tmp_path, flight):
    path = write(tmp_path / "simulated.mcap", flight)
    with Recording(path) as recording:
        raw = recording.messages("/mocap/pose")
    began = raw.log_times_ns[0]
    wall = 1_700_000_000 * SECOND_NS + 3 * (raw.log_times_ns - began)  # a third of speed
    ticks = np.arange(began, raw.log_times_ns[-1], 5_000_000)
    setpoint = "tombo_msgs/msg/PositionSetpoint"
    said = [encode(setpoint, {"header": {"stamp": as_time(t)}}) for t in ticks.tolist()]
    with McapSink(path) as sink:
        channel = sink.add_channel("/mocap/pose", POSE)
        clocked = sink.add_channel("/mission/setpoint", setpoint)
        spoken = 1_700_000_000 * SECOND_NS + 3 * (ticks - began)
        sink.write_columns(Columns(channel, wall, raw.messages), Columns(clocked, spoken, said))
    result = replay_bag(path, ReplayRequest(nodes=("detector",)))
    assert stamps_s(result) == [24.233]
    (known_ns,), _ = result.published["/collision_event"]
    assert known_ns / 1e9 == pytest.approx(24.244, abs=0.006)
    assert result.duration_s == pytest.approx(39.9, abs=0.1)
    assert any("clock was not the recorder's" in finding for finding in result.findings)

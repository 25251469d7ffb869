"""Packed bytes are rclpy's bytes, both ways; what has another shape is refused."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu

from tombo_bag.message_template import MessageTemplate
from tombo_msgs.msg import RotorSpeeds
from tombo_ros.conversion import to_ns, to_time

_number = st.floats(allow_nan=False)
_stamp_ns = st.integers(0, 2**31 * 10**9 - 1)
_BODY, _MAP = {"frame_id": "base_link"}, {"frame_id": "map"}
_SHAPES: dict[str, tuple[Any, dict[str, Any], dict[str, int]]] = {
    "sensor_msgs/msg/Imu": (
        Imu,
        {"header": _BODY},
        {"angular_velocity.x": 3, "linear_acceleration.x": 3, "orientation.x": 4},
    ),
    "geometry_msgs/msg/PoseStamped": (PoseStamped, {"header": _MAP}, {"pose.position.x": 7}),
    "nav_msgs/msg/Odometry": (
        Odometry,
        {"header": _MAP, "child_frame_id": "base_link"},
        {"pose.pose.position.x": 7, "twist.twist.linear.x": 6},
    ),
    "tombo_msgs/msg/RotorSpeeds": (RotorSpeeds, {"header": _BODY}, {"speed": 4}),
}


@lru_cache
def _wire(typename: str, which: str = "reader") -> MessageTemplate:
    return MessageTemplate(typename, _SHAPES[typename][1])


def _values(message: Any) -> list[float]:
    """All numbers of a message but its header, in order."""
    if isinstance(message, float | int):
        return [float(message)]
    if isinstance(message, str):
        return []
    if not hasattr(message, "get_fields_and_field_types"):
        return [float(value) for value in message]
    names = [name for name in message.get_fields_and_field_types() if name != "header"]
    return [number for name in names for number in _values(getattr(message, name))]


@pytest.mark.slow
@pytest.mark.parametrize("typename", list(_SHAPES))
@given(data=st.data())
def test_packed_bytes_are_what_rclpy_reads(typename: str, data: st.DataObject) -> None:
    kind, template, fields = _SHAPES[typename]
    message_template = _wire(typename, "writer")
    stamp = data.draw(_stamp_ns)
    message_template.stamp(stamp)
    put = {}
    for path, count in fields.items():
        put[path] = data.draw(st.lists(_number, min_size=count, max_size=count))
        message_template.field(path, count).put(put[path])
    message = deserialize_message(message_template.data(), kind)
    assert to_ns(message.header.stamp) == stamp
    assert message.header.frame_id == template["header"]["frame_id"]
    found = _values(message)
    for values in put.values():
        joined = ",".join(map(repr, values))
        assert joined in ",".join(map(repr, found))
    assert len(serialize_message(message)) == len(
        message_template.data()
    )  # but for padding the same bytes


@pytest.mark.parametrize("typename", list(_SHAPES))
@given(data=st.data())
def test_rclpys_bytes_fit_and_are_read(typename: str, data: st.DataObject) -> None:
    kind, _, fields = _SHAPES[typename]
    writer, reader = _wire(typename, "writer"), _wire(typename)
    stamp = data.draw(_stamp_ns)
    writer.stamp(stamp)
    put = {
        path: data.draw(st.lists(_number, min_size=n, max_size=n)) for path, n in fields.items()
    }
    for path, values in put.items():
        writer.set(path, *values)
    sent = serialize_message(deserialize_message(writer.data(), kind))
    assert reader.fits(sent)
    assert reader.time("header.stamp").of(sent) == stamp
    for path, values in put.items():
        assert list(reader.field(path, len(values)).of(sent)) == values


def test_a_message_made_by_hand_is_read_field_by_field() -> None:
    message = Odometry()
    message.header.frame_id, message.child_frame_id = "map", "base_link"
    message.header.stamp = to_time(12_345_678_901)
    message.pose.pose.position.x, message.pose.pose.orientation.w = 1.5, 0.25
    message.twist.twist.angular.z = -3.0
    data = serialize_message(message)
    message_template = _wire("nav_msgs/msg/Odometry")
    assert message_template.fits(data)
    assert message_template.time("header.stamp").of(data) == 12_345_678_901
    assert message_template.field("pose.pose.position.x", 7).of(data) == (1.5, 0, 0, 0, 0, 0, 0.25)
    assert message_template.field("twist.twist.linear.x", 6).of(data) == (0, 0, 0, 0, 0, -3.0)


@given(_stamp_ns)
def test_times_survive_the_way_there_and_back(stamp: int) -> None:
    assert to_ns(to_time(stamp)) == stamp


@pytest.mark.parametrize("frame", ["", "map", "base_lin", "base_link2", "base_lind", "/base_link"])
def test_another_frame_does_not_fit(frame: str) -> None:
    message = Imu()
    message.header.frame_id = frame
    assert not _wire("sensor_msgs/msg/Imu").fits(serialize_message(message))


@pytest.mark.parametrize("child", ["", "base_footprint", "map"])
def test_another_child_frame_does_not_fit(child: str) -> None:
    message = Odometry()
    message.header.frame_id, message.child_frame_id = "map", child
    assert not _wire("nav_msgs/msg/Odometry").fits(serialize_message(message))


@pytest.mark.parametrize("typename", list(_SHAPES))
def test_short_bytes_do_not_fit(typename: str) -> None:
    message_template = _wire(typename)
    data = message_template.data()
    assert message_template.fits(data)
    assert not any(message_template.fits(data[:length]) for length in range(len(data)))


@pytest.mark.parametrize("head", [b"\x00\x00\x00\x00", b"\x00\x03\x00\x00", b"\x00\x07\x00\x00"])
def test_big_endian_and_other_encodings_do_not_fit(head: bytes) -> None:
    message_template = _wire("sensor_msgs/msg/Imu")
    assert not message_template.fits(head + message_template.data()[4:])


@given(st.binary(max_size=400))
def test_any_bytes_are_refused_without_an_exception(data: bytes) -> None:
    assert not _wire("tombo_msgs/msg/RotorSpeeds").fits(data)


def test_what_was_packed_stays_until_packed_again() -> None:
    message_template = _wire("tombo_msgs/msg/RotorSpeeds", "by hand")
    first = message_template.data()
    message_template.set("speed", 1.0, 2.0, 3.0, 4.0)
    assert first != message_template.data()
    assert list(deserialize_message(message_template.data(), RotorSpeeds).speed) == [
        1.0,
        2.0,
        3.0,
        4.0,
    ]

"""The bytes against those of ROS 2 itself, where it is installed."""

import importlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_messages import examples, messages
from rosbags.interfaces import Nodetype

from tombo_bag.columnar_cdr import encode
from tombo_bag.schemas import known_types, own_definitions

serialization = pytest.importorskip("rclpy.serialization", reason="rclpy is not installed")
pytest.importorskip("tombo_msgs.msg", reason="tombo_msgs is not built")

TYPES = [
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/BatteryState",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Bool",
    "std_msgs/msg/String",
    "visualization_msgs/msg/Marker",
    *sorted(own_definitions()),
]


def ros_class(typename):
    package, _, name = typename.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def ros_message(typename, values):
    message = ros_class(typename)()
    for name, (kind, content) in known_types()[typename][1]:
        value = values[name]
        if kind == Nodetype.NAME:
            value = ros_message(content, value)
        elif kind != Nodetype.BASE and content[0][0] == Nodetype.NAME:
            value = [ros_message(content[0][1], item) for item in value]
        elif kind == Nodetype.BASE and content[0] == "byte":
            value = bytes([value])
        setattr(message, name, value)
    return message


@pytest.mark.slow
@examples(50)
@given(st.data())
def test_rclpy_reads_what_was_written(data):
    typename = data.draw(st.sampled_from(TYPES))
    values = data.draw(messages(typename))
    read = serialization.deserialize_message(encode(typename, values), ros_class(typename))
    assert repr(read) == repr(ros_message(typename, values))

"""Dataclasses of the cores as bytes of messages and back."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from tombo_bag.columnar_cdr import encode
from tombo_bag.columns import columns_of
from tombo_bag.message_codec import FORMS, MessageCodec, encoded, messages_of
from tombo_bag.schemas import known_types
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import MissionStatus, Pose, neutral


def filled(kind, seed):
    """A message with other numbers in each field."""
    rng = np.random.default_rng(seed)
    plain = neutral(kind, 1_234_567_891)
    values = {}
    for one in fields(kind):
        value = getattr(plain, one.name)
        if isinstance(value, np.ndarray):
            value = rng.standard_normal(value.size)
        elif isinstance(value, float):
            value = float(rng.standard_normal())
        values[one.name] = value
    return kind(**values)


def assert_equal(a, b):
    assert type(a) is type(b)
    for one in fields(a):
        x, y = getattr(a, one.name), getattr(b, one.name)
        assert np.array_equal(x, y, equal_nan=isinstance(x, np.ndarray)), one.name


@pytest.mark.parametrize("typename", sorted(FORMS))
def test_message_survives_bytes_to_the_last_bit(typename):
    codec = MessageCodec(typename)
    for seed in range(3):
        message = filled(FORMS[typename], seed)
        data = codec.encode(message)
        assert_equal(codec.decode(data), message)
        table = columns_of(typename, [data], known_types())
        assert_equal(messages_of(typename, table)[0], message)


@pytest.mark.parametrize("typename", sorted(set(FORMS) - {"tombo_msgs/msg/MissionStatus"}))
def test_columns_give_the_same_bytes_as_one_message(typename):
    message = filled(FORMS[typename], 1)
    types = {"int": np.int64, "float": np.float64, "bool": np.bool_, "Array": np.float64}
    columns = {
        one.name: np.array(2 * [getattr(message, one.name)], types[one.type])
        for one in fields(message)
        if one.type != "str"
    }
    data = MessageCodec(typename).encode(message)
    assert [row.tobytes() for row in encoded(typename, columns)] == [data, data]


def test_texts_of_other_lengths_are_read():
    codec = MessageCodec("tombo_msgs/msg/MissionStatus")
    for text in ("hover", "approach, waits", "", "hover"):
        message = MissionStatus(5, 2, text)
        assert codec.decode(codec.encode(message)) == message


def test_frame_of_a_pose_is_passed_on():
    codec = MessageCodec("geometry_msgs/msg/PoseStamped")
    pose = Pose(7, "odom", np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    assert codec.decode(codec.encode(pose)).frame_id == "odom"


def test_wrong_frame_is_refused_with_both_frames():
    data = encode("nav_msgs/msg/Odometry", {"header": {"frame_id": "odom"}})
    with pytest.raises(InputError, match="'odom'; accepted: 'map'"):
        MessageCodec("nav_msgs/msg/Odometry").decode(data)


def test_bytes_of_no_message_are_refused():
    with pytest.raises(InputError):
        MessageCodec("nav_msgs/msg/Odometry").decode(b"\x00\x01\x00\x00\x01")

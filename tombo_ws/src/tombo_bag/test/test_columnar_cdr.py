import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_messages import ALL_TYPES, examples, messages

from tombo_bag.columnar_cdr import encode, layout_of
from tombo_bag.schemas import known_types, parse_schema
from tombo_dynamics.errors import InputError

MANY = examples(300)
ODOMETRY = "nav_msgs/msg/Odometry"
FRAMES = {"header": {"frame_id": "map"}, "child_frame_id": "base_link"}


@pytest.mark.slow
@MANY
@given(st.data())
def test_any_message_can_be_built_from_any_other_of_its_shape(data):
    """Copy all numbers and texts through the layout: nothing but padding may be left out."""
    typename = data.draw(st.sampled_from(ALL_TYPES))
    message = encode(typename, data.draw(messages(typename)))
    shape = layout_of(typename, message, known_types())
    numbers = np.frombuffer(message, shape.dtype)
    copy = bytearray(len(message))
    copied = np.frombuffer(copy, shape.dtype)
    for name in shape.dtype.names or ():
        copied[name] = numbers[name]
    for offset in (0, *shape.counts):
        copy[offset : offset + 4] = message[offset : offset + 4]
    assert bytes(copy) == message


@pytest.mark.parametrize(
    ("typename", "values", "part"),
    [
        (ODOMETRY, {"hedder": {}}, "hedder"),
        (ODOMETRY, {"pose": {"pose": {"position": {"q": 1.0}}}}, "pose.pose.position.q"),
        (
            ODOMETRY,
            {"pose": {"covariance": [1.0]}},
            "pose.covariance has 1 elements; accepted: 36",
        ),
        ("nav_msgs/msg/Nothing", {}, "nav_msgs/msg/Nothing"),
    ],
)
def test_bad_values_are_named(typename, values, part):
    with pytest.raises(InputError) as error:
        encode(typename, values)
    assert part in str(error.value)


@pytest.mark.parametrize("cut", [1, 4, 9, 40])
def test_bytes_that_end_too_early_are_no_message(cut):
    message = encode(ODOMETRY, FRAMES)
    with pytest.raises(InputError, match=r"nav_msgs/msg/Odometry (ends|starts)"):
        layout_of(ODOMETRY, message[:-cut] if cut < 40 else message[:cut], known_types())


def test_a_count_larger_than_the_message_is_refused():
    message = bytearray(encode("tf2_msgs/msg/TFMessage", {"transforms": [FRAMES]}))
    message[4:8] = b"\xff\xff\xff\xff"
    with pytest.raises(InputError, match="ends too early"):
        layout_of("tf2_msgs/msg/TFMessage", bytes(message), known_types())


def test_a_message_without_fields_takes_a_byte():
    text = "c/Nothing[] many\nc/Nothing one\nuint8 x\n" + "=" * 80 + "\nMSG: c/Nothing\n"
    types = parse_schema("a/msg/B", text)
    message = bytes.fromhex("00010000 02000000 00000007")
    assert layout_of("a/msg/B", message, types).leaves[-1].offset == 11
    with pytest.raises(InputError, match="ends too early"):
        layout_of("a/msg/B", message[:4] + b"\xff\xff\xff\xff" + message[8:], types)

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_messages import ALL_TYPES, as_object, examples, messages

from tombo_bag.columnar_cdr import encode, layout, layout_of
from tombo_bag.schemas import known_types, parse_schema, type_store
from tombo_dynamics.errors import InputError

MANY = examples(300)
ODOMETRY = "nav_msgs/msg/Odometry"
FRAMES = {"header": {"frame_id": "map"}, "child_frame_id": "base_link"}


@pytest.mark.slow
@MANY
@given(st.data())
def test_any_message_has_the_bytes_that_rosbags_gives_it(data):
    typename = data.draw(st.sampled_from(ALL_TYPES))
    values = data.draw(messages(typename))
    expected = bytes(type_store().serialize_cdr(as_object(typename, values), typename))
    assert encode(typename, values) == expected


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


def test_columns_give_the_bytes_of_messages_written_one_by_one():
    rng = np.random.default_rng(1)
    position, covariance = rng.normal(size=(50, 3)), rng.normal(size=(50, 36))
    records = layout(ODOMETRY, FRAMES).records(50)
    records["header.stamp.sec"] = np.arange(50)
    for i, axis in enumerate("xyz"):
        records[f"pose.pose.position.{axis}"] = position[:, i]
    records["pose.covariance"] = covariance
    store = type_store()
    for i, record in enumerate(records):
        values = {
            "header": {"stamp": {"sec": i, "nanosec": 0}, "frame_id": "map"},
            "child_frame_id": "base_link",
            "pose": {
                "pose": {"position": dict(zip("xyz", position[i], strict=True))},
                "covariance": covariance[i],
            },
        }
        assert record.tobytes() == encode(ODOMETRY, values)
        read = store.deserialize_cdr(record.tobytes(), ODOMETRY)
        assert read.pose.pose.position.y == position[i, 1]
        assert read.child_frame_id == "base_link"


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
        ("sensor_msgs/msg/JointState", {"name": "wheel"}, "name is 'wheel'"),
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

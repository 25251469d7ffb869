import importlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_messages import examples, messages

from tombo_bag.columnar_cdr import encode
from tombo_bag.formats.padding import without_padding
from tombo_bag.schemas import known_types, type_store

FEW = examples(60)
SMALL_TYPES = [
    "diagnostic_msgs/msg/KeyValue",
    "geometry_msgs/msg/PoseStamped",
    "sensor_msgs/msg/BatteryState",
    "std_msgs/msg/Empty",
    "tombo_msgs/msg/DetectorStatus",
    "tombo_msgs/msg/MissionStatus",
]


def cleaned(typename, many):
    return without_padding(typename, many, known_types())


def places_that_mean_nothing(typename, message):
    """Bytes whose value makes no difference to what another library reads."""
    store = type_store()
    meant = repr(store.deserialize_cdr(message, typename))
    for at in range(4, len(message)):
        others = [bytes([*message[:at], value, *message[at + 1 :]]) for value in (0, 0x41, 0xFF)]
        try:
            if all(repr(store.deserialize_cdr(other, typename)) == meant for other in others):
                yield at
        except Exception:  # a length or a text is broken
            continue


@pytest.mark.slow
@FEW
@given(st.data())
def test_what_means_nothing_goes_and_all_else_stays(data):
    typename = data.draw(st.sampled_from(SMALL_TYPES))
    clean = encode(typename, data.draw(messages(typename)))
    dirty = bytearray(clean)
    for at in places_that_mean_nothing(typename, clean):
        dirty[at] = data.draw(st.integers(1, 255))
    dirty += data.draw(st.binary(max_size=8))
    if typename == "std_msgs/msg/Empty":
        clean = clean[:4] + bytes(dirty[4:5])  # its one byte is a field of DDS's making
    assert cleaned(typename, [bytes(dirty)]) == [clean]


def test_shapes_of_equal_size_are_told_apart_and_order_is_kept():
    typename = "diagnostic_msgs/msg/KeyValue"
    pairs = [("aaaa", "b"), ("c", "dddd"), ("eeee", "f"), ("", ""), ("gg", "hhh")] * 3
    clean = [encode(typename, {"key": k, "value": v}) for k, v in pairs]
    dirty = [message + b"\xaa" * (20 + i % 2 - len(message)) for i, message in enumerate(clean)]
    assert cleaned(typename, dirty) == clean
    assert cleaned(typename, dirty[::-1]) == clean[::-1]


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\x00\x01",
        b"\x00\x00\x00\x00" + bytes(60),  # big endian
        b"\x00\x03\x00\x00" + bytes(60),  # a parameter list
        b"\x00\x01\x00\x00\x01\x02",  # too short for a pose
        b"\x00\x01\x00\x00" + bytes(8) + b"\xff\xff\xff\x7f" + bytes(60),
    ],
)
def test_what_is_no_such_message_stays_as_it_is(message):
    typename = "geometry_msgs/msg/PoseStamped"
    whole = encode(typename, {"header": {"frame_id": "map"}})
    many = [message, whole + b"\1" * 5, message]
    assert cleaned(typename, many) == [message, whole, message]


@pytest.mark.slow
@FEW
@given(st.data())
def test_bytes_of_rclpy_become_those_of_this_package(data):
    """What rclpy leaves in the gaps between fields, and behind the last one, is not defined."""
    serialization = pytest.importorskip("rclpy.serialization", reason="rclpy is not installed")
    pytest.importorskip("tombo_msgs.msg", reason="tombo_msgs is not built")
    theirs = importlib.import_module("test_against_rclpy")
    typename = data.draw(st.sampled_from(theirs.TYPES))
    values = data.draw(messages(typename))
    raw = serialization.serialize_message(theirs.ros_message(typename, values))
    (clean,) = cleaned(typename, [raw])
    assert clean == encode(typename, values)

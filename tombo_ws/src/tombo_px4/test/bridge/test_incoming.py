"""What PX4 says: read into our axes and units, or refused under a word; nothing raises."""

import math

import pytest
from bridge_flight import BOOT, NOW, synced
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mav

from tombo_px4.link.mavlink_link import Received
from tombo_px4.link.messages import MessageDecoder, decode_parameter, float_of_int
from tombo_px4.modes import OFFBOARD, custom_mode

NAN = math.nan
UNKNOWN = tuple([NAN] + 20 * [0.0])
LEVEL = [1.0, 0.0, 0.0, 0.0]


@pytest.fixture
def decoder():
    return MessageDecoder(synced(), 245, 191)


def over_the_wire(message):
    out = mav.MAVLink(None, 1, 1)
    return mav.MAVLink(None).parse_buffer(message.pack(out))[0]


def read(decoder, message, arrival=NOW):
    return decoder.read(Received(over_the_wire(message), arrival, 1, 1, None))


def odometry(**fields):
    values = {"time_usec": BOOT // 1000, "frame_id": mav.MAV_FRAME_LOCAL_NED}
    values |= {"child_frame_id": mav.MAV_FRAME_BODY_FRD, "q": LEVEL}
    values |= {"x": 2.0, "y": 1.0, "z": -3.0, "vx": 1.0, "vy": 2.0, "vz": 3.0}
    values |= {"rollspeed": 0.1, "pitchspeed": 0.2, "yawspeed": 0.3}
    values |= dict.fromkeys(("pose_covariance", "velocity_covariance"), UNKNOWN)
    return mav.MAVLink_odometry_message(**{**values, **fields})


def test_odometry_comes_in_our_axes_with_our_stamp(decoder):
    record = read(decoder, odometry(), NOW + 3_000_000)
    assert record.position == pytest.approx([1.0, 2.0, 3.0])
    # level, nose north: yaw 90 deg from east; its velocity forward is north
    assert record.attitude == pytest.approx([0, 0, math.sqrt(0.5), math.sqrt(0.5)])
    assert record.velocity == pytest.approx([2.0, 1.0, -3.0])
    assert record.rates == pytest.approx([0.1, -0.2, -0.3])
    assert abs(record.stamp_ns - NOW) < 200_000
    assert record.pose_covariance is None


def test_velocity_in_the_world_is_not_turned(decoder):
    q = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # nose east
    record = read(decoder, odometry(child_frame_id=mav.MAV_FRAME_LOCAL_NED, q=q))
    assert record.velocity == pytest.approx([2.0, 1.0, -3.0])
    record = read(decoder, odometry(q=q))
    assert record.velocity == pytest.approx([1.0, -2.0, -3.0], abs=1e-6)


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"x": NAN}, "not_finite"),
        ({"vz": math.inf}, "not_finite"),
        ({"yawspeed": NAN}, "not_finite"),
        ({"q": [NAN, 0, 0, 0]}, "not_finite"),
        ({"q": [0.0, 0, 0, 0]}, "not_unit"),
        ({"q": [2.0, 0, 0, 0]}, "not_unit"),
        ({"frame_id": mav.MAV_FRAME_LOCAL_FRD}, "wrong_frame"),
        ({"frame_id": mav.MAV_FRAME_LOCAL_ENU}, "wrong_frame"),
        ({"child_frame_id": mav.MAV_FRAME_LOCAL_FRD}, "wrong_frame"),
        ({"x": 1e9}, "range"),
        ({"rollspeed": 1e4}, "range"),
        ({"time_usec": 0}, "stamp"),
        ({"time_usec": NOW // 1000}, "stamp"),
        ({"time_usec": BOOT // 1000 - 5_000_000}, "stamp"),
        ({"time_usec": BOOT // 1000 + 5_000_000}, "stamp"),
    ],
)
def test_odometry_that_cant_be_right_is_refused_by_word(decoder, fields, word):
    assert read(decoder, odometry(**fields)) is None
    assert decoder.refused == {f"ODOMETRY.{word}": 1}


def heartbeat(autopilot=mav.MAV_AUTOPILOT_PX4, base_mode=0x81, mode=OFFBOARD):
    return mav.MAVLink_heartbeat_message(2, autopilot, base_mode, custom_mode(mode), 4, 3)


def test_a_heartbeat_tells_armed_and_mode(decoder):
    record = read(decoder, heartbeat())
    assert (record.armed, record.mode, record.arrival_ns) == (True, OFFBOARD, NOW)
    assert not read(decoder, heartbeat(base_mode=0x01)).armed
    assert read(decoder, heartbeat(autopilot=mav.MAV_AUTOPILOT_INVALID)) is None
    assert not decoder.refused
    assert read(decoder, heartbeat(autopilot=mav.MAV_AUTOPILOT_ARDUPILOTMEGA)) is None
    assert decoder.refused["HEARTBEAT.not_px4"] == 1


def imu(**fields):
    others = ["xmag", "ymag", "zmag", "abs_pressure", "diff_pressure", "pressure_alt"]
    values = dict.fromkeys([*others, "temperature"], 0.0)
    values |= {"time_usec": BOOT // 1000, "xacc": 0.1, "yacc": 0.2, "zacc": -9.8}
    values |= {"xgyro": 0.1, "ygyro": 0.2, "zgyro": 0.3, "fields_updated": 0x3F}
    return mav.MAVLink_highres_imu_message(**{**values, **fields})


def test_the_imu_comes_forward_left_up(decoder):
    record = read(decoder, imu())
    assert record.accel == pytest.approx([0.1, -0.2, 9.8])
    assert record.gyro == pytest.approx([0.1, -0.2, -0.3])
    for fields, word in (
        ({"xacc": NAN}, "not_finite"),
        ({"zgyro": math.inf}, "not_finite"),
        ({"fields_updated": 0x07}, "incomplete"),
        ({"zacc": 1e6}, "range"),
    ):
        assert read(decoder, imu(**fields)) is None
        assert decoder.refused[f"HIGHRES_IMU.{word}"] > 0


def test_acks_for_others_are_not_ours(decoder):
    def ack(*target):
        return read(decoder, mav.MAVLink_command_ack_message(176, 1, 0, 0, *target))

    record = ack()
    assert (record.command, record.result) == (176, 1)
    assert ack(245, 191) is not None
    assert ack(255, 191) is ack(245, 190) is None
    assert decoder.refused["COMMAND_ACK.not_for_us"] == 2


@given(st.integers(-(2**22), 2**22))
def test_whole_numbers_travel_by_their_bytes(value):
    content = (b"EKF2_EV_CTRL", float_of_int(value), mav.MAV_PARAM_TYPE_INT32, 900, 7)
    record = decode_parameter(mav.MAVLink_param_value_message(*content))
    assert (record.name.strip("b'"), record.value) == ("EKF2_EV_CTRL", value)


def text(words, number=0, chunk=0, severity=4):
    return mav.MAVLink_statustext_message(severity, words.encode(), number, chunk)


@pytest.mark.parametrize(
    "pieces",
    [
        ("Arming denied: " + "x" * 35, "y" * 50, "Resolve system health failures first"),
        ("y" * 50, ""),
        ("Ready",),
    ],
)
def test_texts_in_pieces_are_joined(decoder, pieces):
    *_, record = (read(decoder, text(words, 7, place)) for place, words in enumerate(pieces))
    assert record.text == "".join(pieces)

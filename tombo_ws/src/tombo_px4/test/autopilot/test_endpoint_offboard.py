import math

import numpy as np
import pytest
from endpoint_bench import ARM, OFFBOARD, SET_MODE, of, texts
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.frames import GeoOrigin, px4_quaternion
from tombo_px4.protocol.input_decoder import decode_setpoint

NAN = math.nan
MAV = mavlink.MAVLink(None, 1, 1)
ORIGIN = GeoOrigin(47.0, 8.0, 400.0)
HOME = np.array([1.0, 2.0, 0.2])
LOCAL, BODY = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_NED
POSITION, VELOCITY, ACCELERATION = 0b110111111000, 0b110111000111, 0b110000111111
ALL = 0


def local(
    mask, place=(1, 2, -3), speed=(4, 5, -6), push=(7, 8, -9), yaw=0.3, rate=0.2, frame=LOCAL
):
    return MAV.set_position_target_local_ned_encode(
        0, 1, 1, frame, mask, *place, *speed, *push, yaw, rate
    )


def attitude(mask, q=(1.0, 0.0, 0.0, 0.0), rates=(0.1, 0.2, 0.3), thrust=0.5):
    return MAV.set_attitude_target_encode(0, 1, 1, mask, list(q), *rates, thrust)


def read(message):
    return decode_setpoint(message, ORIGIN, HOME, 77)


def test_position_velocity_and_acceleration_are_turned_to_our_axes():
    target = read(local(ALL))
    assert target.position == pytest.approx([2, 1, 3])
    assert target.velocity == pytest.approx([5, 4, 6])
    assert target.acceleration == pytest.approx([8, 7, 9])
    assert target.yaw == pytest.approx(math.pi / 2 - 0.3)
    assert target.yaw_rate == pytest.approx(-0.2)
    assert (target.stamp_us, target.frame) == (77, "map")


@pytest.mark.parametrize(
    ("mask", "kept"),
    [
        (POSITION, "position"),
        (VELOCITY, "velocity"),
        (ACCELERATION, "acceleration"),
        (0b100111111000, "position"),
    ],
)
def test_what_the_mask_ignores_is_not_commanded(mask, kept):
    target = read(local(mask))
    for name in ("position", "velocity", "acceleration"):
        assert (getattr(target, name) is not None) == (name == kept)
    assert math.isnan(target.yaw) == bool(mask & 1 << 10)
    assert math.isnan(target.yaw_rate)


@given(st.integers(0, 0b111111111), st.integers(0, 0b111111111))
def test_each_axis_is_commanded_alone(mask, missing):
    """As with PX4, NaN and a bit of the mask mean the same."""
    values = [float(i + 1) if not missing & 1 << i else NAN for i in range(9)]
    target = read(local(mask, values[:3], values[3:6], values[6:]))
    left = [values[i] if not (mask | missing) & 1 << i else NAN for i in range(9)]
    if all(math.isnan(v) for v in left):
        assert target == "invalid: nothing is commanded"
        return
    for k, name in enumerate(("position", "velocity", "acceleration")):
        north, east, down = left[3 * k : 3 * k + 3]
        axis = getattr(target, name)
        axes = [east, north, -down]
        if all(math.isnan(a) for a in axes):
            assert axis is None
        else:
            assert axis == pytest.approx(axes, nan_ok=True)


def test_a_velocity_in_the_body_is_front_left_up():
    target = read(local(VELOCITY, frame=BODY))
    assert target.frame == "body"
    assert target.velocity == pytest.approx([4, -5, 6])
    assert target.position is None


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (local(ALL, frame=mavlink.MAV_FRAME_LOCAL_ENU), "coordinate frame 4 unsupported"),
        (local(ALL, frame=mavlink.MAV_FRAME_BODY_FRD), "coordinate frame 12 unsupported"),
        (local(ALL, frame=200), "coordinate frame 200 unsupported"),
        (local(0b110111111111), "invalid: nothing is commanded"),
        (local(POSITION, frame=BODY), "invalid: position in a body frame"),
        (local(ACCELERATION | 1 << 9), "force not supported"),
        (local(POSITION, place=(math.inf, 0, 0)), "position is out of range"),
        (local(POSITION, place=(1e9, 0, 0)), "position is out of range"),
        (local(VELOCITY, speed=(0, -1e4, 0)), "velocity is out of range"),
        (local(ACCELERATION, push=(0, 0, math.inf)), "acceleration is out of range"),
        (local(ALL, yaw=1e9), "yaw is out of range"),
        (local(ALL, rate=-math.inf), "yaw is out of range"),
        (attitude(0b111, q=(0, 0, 0, 0)), "attitude is no unit quaternion"),
        (attitude(0b111, q=(NAN, 0, 0, 0)), "attitude is not finite"),
        (attitude(0b111, thrust=NAN), "thrust is out of range"),
        (attitude(0b111, thrust=1.5), "thrust is out of range"),
        (attitude(0b1000111), "invalid: no thrust"),
        (attitude(0b10000111), "invalid: nothing is commanded"),
        (attitude(0b10000000, rates=(0, 1e6, 0)), "rates are out of range"),
    ],
)
def test_a_set_point_that_cannot_be_meant_is_refused_with_the_reason(message, reason):
    assert read(message) == reason


def test_an_attitude_is_turned_to_our_frames():
    yaw, tilt = 0.4, 0.2
    ours = np.array([0.0, math.sin(tilt / 2), 0.0, math.cos(tilt / 2)])
    target = read(attitude(0b111, q=px4_quaternion(ours)))
    assert target.attitude == pytest.approx(ours, abs=1e-7)
    assert target.rates is None
    assert target.thrust == 0.5
    level = read(attitude(0b111, q=(math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)))).attitude
    x, y, z, w = level
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(
        math.pi / 2 - yaw
    )


def test_rates_are_turned_to_our_body():
    target = read(attitude(0b10000000))
    assert target.attitude is None
    assert target.rates == pytest.approx([0.1, -0.2, -0.3])
    assert read(attitude(0b10000011)).rates[2] == pytest.approx(-0.3)


@pytest.mark.parametrize(
    ("frame", "altitude", "up"),
    [
        (mavlink.MAV_FRAME_GLOBAL_INT, 403.0, 3.0),
        (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 3.0, 3.2),
    ],
)
def test_a_place_on_the_globe_is_turned_to_the_map(frame, altitude, up):
    latitude, longitude, _ = ORIGIN.global_of((30.0, -20.0, 0.0))
    message = MAV.set_position_target_global_int_encode(
        0, 1, 1, frame, POSITION, round(1e7 * latitude), round(1e7 * longitude), altitude,
        *6 * [0.0], 0.0, 0.0,
    )  # fmt: skip
    assert read(message).position == pytest.approx([30.0, -20.0, up], abs=0.02)


@pytest.mark.parametrize(
    ("frame", "latitude", "reason"),
    [(1, 0, "coordinate frame 1 unsupported"), (5, 2_000_000_000, "position is out of range")],
)
def test_a_place_that_is_none_is_refused(frame, latitude, reason):
    message = MAV.set_position_target_global_int_encode(
        0, 1, 1, frame, POSITION, latitude, 0, 400.0, *6 * [0.0], 0.0, 0.0
    )
    assert read(message) == reason


anything = st.floats(width=32)


@pytest.mark.slow
@given(
    st.integers(0, 255),
    st.integers(0, 65535),
    st.lists(anything, min_size=11, max_size=11),
    st.lists(anything, min_size=8, max_size=8),
)
def test_whatever_comes_is_a_target_within_bounds_or_a_reason(frame, mask, motion, pointing):
    for message in (
        MAV.set_position_target_local_ned_encode(0, 1, 1, frame, mask, *motion),
        MAV.set_attitude_target_encode(0, 1, 1, mask & 255, pointing[:4], *pointing[4:]),
    ):
        target = read(message)
        assert isinstance(target, str | OffboardSetpoint)
        if isinstance(target, OffboardSetpoint):
            for values in (target.position, target.velocity, target.acceleration, target.rates):
                assert values is None or not (np.abs(values) > 1e5).any()
            if target.attitude is not None:
                assert np.linalg.norm(target.attitude) == pytest.approx(1.0)


@pytest.mark.parametrize("target", [(2, 1), (1, 9)])
def test_set_points_for_another_vehicle_are_ignored(target, b):
    b.acks(SET_MODE, *OFFBOARD)
    message = local(POSITION)
    message.target_system, message.target_component = target
    b.client.send(message)
    b.run(0.1)
    assert b.acks(ARM, 1.0) == [1]


def test_a_bad_set_point_is_no_sign_of_life_and_is_reported_once(b):
    b.acks(SET_MODE, *OFFBOARD)
    b.each_round = lambda: b.client.send(local(POSITION, place=(math.inf, 0, 0)))
    heard = b.run(1.0)
    assert texts(heard) == ["SET_POSITION_TARGET_LOCAL_NED position is out of range"]
    assert b.acks(ARM, 1.0) == [1]


@pytest.mark.slow
@pytest.mark.parametrize("ways", ["attitude", "rates"])
def test_thrust_and_attitude_or_rates_lift_the_vehicle(ways, b):
    hover = b.vehicle.parameters.get("MPC_THR_HOVER")
    heading = b.vehicle.estimate.attitude

    def stream():
        q = px4_quaternion(heading).tolist()
        b.client.send(
            attitude(0b111, q, thrust=1.1 * hover)
            if ways == "attitude"
            else attitude(0b10000000, rates=(0, 0, 0), thrust=1.1 * hover)
        )

    b.each_round = stream
    b.run(0.2)
    assert b.acks(SET_MODE, *OFFBOARD)[-1] == 0
    assert b.acks(ARM, 1.0) == [0]
    ground = b.vehicle.simulator.height
    b.run(4.0)
    assert b.vehicle.simulator.height > ground + 0.3
    assert of(b.client.seen, "ATTITUDE_TARGET")[-1].thrust == pytest.approx(1.1 * hover, rel=0.1)

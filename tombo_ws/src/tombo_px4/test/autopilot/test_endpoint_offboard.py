import math

import numpy as np
import pytest
from endpoint_bench import ARM, OFFBOARD, SET_MODE, texts
from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.frames import px4_quaternion
from tombo_px4.protocol.requests import decode_setpoint

NAN = math.nan
MAV = mavlink.MAVLink(None, 1, 1)
LOCAL = mavlink.MAV_FRAME_LOCAL_NED
POSITION, VELOCITY, ACCELERATION = 0b110111111000, 0b110111000111, 0b110000111111
ALL = 0


def local(
    mask, place=(1, 2, -3), speed=(4, 5, -6), push=(7, 8, -9), yaw=0.3, rate=0.2, frame=LOCAL
):
    return MAV.set_position_target_local_ned_encode(
        0, 1, 1, frame, mask, *place, *speed, *push, yaw, rate
    )


def attitude(mask, q=(1.0, 0.0, 0.0, 0.0), thrust=0.5):
    return MAV.set_attitude_target_encode(0, 1, 1, mask, list(q), 0.1, 0.2, 0.3, thrust)


def read(message):
    return decode_setpoint(message)


def test_position_velocity_and_acceleration_are_turned_to_our_axes():
    target = read(local(ALL))
    assert target.position == pytest.approx([2, 1, 3])
    assert target.velocity == pytest.approx([5, 4, 6])
    assert target.acceleration == pytest.approx([8, 7, 9])
    assert target.yaw == pytest.approx(math.pi / 2 - 0.3)


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
        assert np.isfinite(getattr(target, name)).any() == (name == kept)
    assert math.isnan(target.yaw) == bool(mask & 1 << 10)


def test_an_attitude_is_turned_to_our_frames():
    yaw, tilt = 0.4, 0.2
    ours = np.array([0.0, math.sin(tilt / 2), 0.0, math.cos(tilt / 2)])
    target = read(attitude(0b111, q=px4_quaternion(ours)))
    assert target.attitude == pytest.approx(ours, abs=1e-7)
    assert target.thrust == 0.5
    level = read(attitude(0b111, q=(math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)))).attitude
    x, y, z, w = level
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(
        math.pi / 2 - yaw
    )


def test_a_bad_set_point_is_no_sign_of_life_and_is_reported_once(b):
    b.acks(SET_MODE, *OFFBOARD)
    b.each_round = lambda: b.client.send(local(POSITION, place=(math.inf, 0, 0)))
    heard = b.run(1.0)
    assert texts(heard) == ["invalid set point: an axis is not commanded"]
    assert b.acks(ARM, 1.0) == [1]

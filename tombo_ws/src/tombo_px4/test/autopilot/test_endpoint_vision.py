import math

import numpy as np
import pytest
from endpoint_bench import bench, of
from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.frames import ned_from_enu, px4_quaternion
from tombo_px4.protocol.requests import decode_vision

NAN = math.nan
MAV = mavlink.MAVLink(None, 1, 1)
NOTHING = 21 * [NAN]
NED, FRD, BODY = (
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_LOCAL_FRD,
    mavlink.MAV_FRAME_BODY_FRD,
)
VISION, MOCAP = mavlink.MAV_ESTIMATOR_TYPE_VISION, mavlink.MAV_ESTIMATOR_TYPE_MOCAP
LAB = {"EKF2_GPS_CTRL": 0, "SYS_HAS_GPS": 0, "EKF2_EV_CTRL": 11, "EKF2_HGT_REF": 3}
PLACE = np.array([1.0, -2.0, 0.3])
"""In map."""
YAW = 2.0
ATTITUDE = np.array([0.0, 0.0, math.sin(0.5 * YAW), math.cos(0.5 * YAW)])


def odometry(mav=MAV, stamp_us=5, frame=NED, child=BODY, kind=VISION, position=None, q=None):
    place = ned_from_enu(PLACE).tolist() if position is None else position
    attitude = px4_quaternion(ATTITUDE).tolist() if q is None else q
    return mav.odometry_encode(
        stamp_us, frame, child, *place, attitude, *6 * [NAN], NOTHING, NOTHING, 0, kind, 100
    )


def estimate(mav=MAV, stamp_us=5, place=None, angles=None):
    place = ned_from_enu(PLACE).tolist() if place is None else place
    return mav.vision_position_estimate_encode(
        stamp_us, *place, *((0.0, 0.0, math.pi / 2 - YAW) if angles is None else angles), NOTHING
    )


@pytest.mark.parametrize("message", [odometry(), odometry(frame=FRD), estimate()])
def test_a_pose_is_read_in_our_frames(message):
    pose = decode_vision(message)
    assert pose.stamp_us == 5
    assert pose.position == pytest.approx(PLACE)
    assert pose.attitude == pytest.approx(ATTITUDE)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (odometry(kind=MOCAP), "with the type MOCAP is not fused"),
        (odometry(frame=mavlink.MAV_FRAME_LOCAL_ENU), "frame 4 unsupported"),
        (odometry(frame=mavlink.MAV_FRAME_BODY_FRD), "frame 12 unsupported"),
        (odometry(child=mavlink.MAV_FRAME_GLOBAL), "child frame 0 unsupported"),
        (MAV.att_pos_mocap_encode(5, [1, 0, 0, 0], 0, 0, 0, NOTHING), "is not fused"),
    ],
)
def test_a_pose_that_cannot_be_used_is_refused_with_the_reason(message, reason):
    refused = decode_vision(message)
    assert isinstance(refused, str) and refused.startswith(reason)


def stream(b, make, rate_rounds=5):
    """Send a pose every few rounds; the client's clock is far from the vehicle's."""

    def each_round():
        b.client_us = b.boot_ns // 1000 + 7_000_000_000_000
        for request in of(b.client.seen, "TIMESYNC"):
            if request.tc1 == 0:
                b.client.send(b.client.mav.timesync_encode(b.client_us * 1000, request.ts1))
        b.client.seen.clear()
        if b.boot_ns // 4_000_000 % rate_rounds == 0:
            b.client.send(make(b))

    b.each_round = each_round


@pytest.mark.slow
@pytest.mark.parametrize("kind", [odometry, estimate])
def test_vision_moves_the_estimate_to_where_it_says(kind):
    with bench(**LAB) as b:
        stream(b, lambda b: kind(b.client.mav, b.client_us - 20_000))
        b.run(3.0)
        assert b.endpoint.channels[0].timesync.converged
        assert b.vehicle.ekf2_model.source == "vision"
        assert b.vehicle.estimate.position == pytest.approx(PLACE, abs=0.02)
        sent = b.wait("ODOMETRY")
        assert (sent.x, sent.y, sent.z) == pytest.approx((-2.0, 1.0, -0.3), abs=0.02)
        attitude = b.wait("ATTITUDE")
        assert attitude.yaw == pytest.approx(math.pi / 2 - YAW, abs=0.03)
        status = b.wait("SYS_STATUS").onboard_control_sensors_health
        assert status & mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION


@pytest.mark.slow
def test_stamps_are_converted_with_timesync(monkeypatch):
    with bench(**LAB) as b:
        stamps = []
        vision = b.vehicle.vision
        monkeypatch.setattr(
            b.vehicle,
            "vision",
            lambda us, p, q: stamps.append((b.boot_ns, us)) or vision(us, p, q),
        )
        stream(b, lambda b: odometry(b.client.mav, b.client_us - 40_000))
        b.run(3.0)
    ages = [boot_ns / 1e3 - us for boot_ns, us in stamps]
    assert max(ages[:10]) < 20_000, "before TIMESYNC has converged the time of arrival counts"
    assert ages[-20:] == pytest.approx(20 * [40_000], abs=8_000)

import math
from itertools import pairwise

import pytest
from endpoint_bench import ARM, OFFBOARD, SET_MODE, bench, of, texts
from pymavlink.dialects.v20 import common as mavlink

NAN = math.nan
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
SET_INTERVAL, REQUEST = 511, 512


def heartbeat(b):
    return b.wait("HEARTBEAT")


def armed(b):
    return bool(heartbeat(b).base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)


@pytest.mark.slow
def test_in_the_air_only_force_stops_the_rotors(fresh):
    fresh.take_off(0.6)
    assert fresh.acks(ARM, 0.0) == [REJECTED]
    assert armed(fresh)
    assert fresh.acks(ARM, 0.0, 21196.0) == [ACCEPTED]
    assert not armed(fresh)


def test_a_mode_is_acknowledged_twice_first_always_with_accepted(b):
    assert b.acks(SET_MODE, *OFFBOARD) == [ACCEPTED, ACCEPTED]
    assert heartbeat(b).custom_mode == 6 << 16
    assert b.acks(SET_MODE, 1.0, 4.0, 99.0) == [ACCEPTED, REJECTED]
    # unknown, or without the flag: PX4 says yes and changes nothing
    assert b.acks(SET_MODE, 1.0, 9.0, 0.0) == [ACCEPTED, ACCEPTED]
    assert b.acks(SET_MODE, 1.0, NAN, 0.0) == [ACCEPTED, ACCEPTED]
    assert b.acks(SET_MODE, 0.0, 4.0, 3.0) == [ACCEPTED, ACCEPTED]
    assert heartbeat(b).custom_mode == 6 << 16


@pytest.mark.parametrize("target", [(2, 1), (0, 1), (1, 42), (0, 0)])
def test_commands_for_another_vehicle_are_ignored(target, b):
    assert b.acks(ARM, 1.0, target=target) == []
    assert b.acks(31000, target=target) == []
    assert not b.vehicle.armed
    assert b.endpoint.refused["addressed to another"] == 2


def test_a_position_that_is_not_known_is_not_told():
    with bench(EKF2_GPS_CTRL=0, SYS_HAS_GPS=0) as b:
        assert b.acks(REQUEST, 32.0) == [DENIED]
        kinds = {m.get_type() for m in b.run(1.0)}
        assert "ATTITUDE" in kinds
        assert not kinds & {"LOCAL_POSITION_NED", "ODOMETRY", "GLOBAL_POSITION_INT"}


@pytest.mark.parametrize(("enabled", "answer", "left"), [(1, ACCEPTED, 0), (0, DENIED, 100)])
def test_a_battery_fails_where_failures_are_enabled(enabled, answer, left):
    with bench(SYS_FAILURE_EN=enabled) as b:
        inject = mavlink.MAV_CMD_INJECT_FAILURE
        battery = float(mavlink.FAILURE_UNIT_SYSTEM_BATTERY)
        assert b.acks(inject, battery, float(mavlink.FAILURE_TYPE_OFF)) == [answer]
        assert b.acks(inject, battery, float(mavlink.FAILURE_TYPE_STUCK)) == [UNSUPPORTED]
        b.run(0.5)
        assert b.wait("SYS_STATUS").battery_remaining == left


def test_intervals_are_set(b):
    assert b.acks(SET_INTERVAL, 331.0, 10_000.0) == [ACCEPTED]
    stamps = [m.time_usec for m in of(b.run(1.0), "ODOMETRY")]
    assert len(stamps) == pytest.approx(100, abs=1)
    assert {b - a for a, b in pairwise(stamps)} == {10_000}
    assert b.acks(SET_INTERVAL, 331.0, -1.0) == [ACCEPTED]
    assert not of(b.run(0.5), "ODOMETRY")


def test_checks_name_what_is_wrong():
    with bench(EKF2_GPS_CTRL=0, SYS_HAS_GPS=0) as b:
        b.run(1.0)
        assert b.acks(401) == [ACCEPTED]
        assert any("position" in t for t in texts(b.client.seen))

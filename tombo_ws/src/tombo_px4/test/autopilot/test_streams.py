from collections import Counter

import pytest

from tombo_px4.protocol.mavlink_channel import StreamTable
from tombo_px4.protocol.telemetry import _BUILDERS

OFFERED = {number: name for number, (name, _) in _BUILDERS.items()}
HEARTBEAT, ATTITUDE, TRUTH, BATTERY = 0, 30, 115, 147
MEASURED_HZ = {
    "HEARTBEAT": 1,
    "ATTITUDE": 99,
    **dict.fromkeys(("ATTITUDE_QUATERNION", "HIGHRES_IMU", "GLOBAL_POSITION_INT"), 49),
    **dict.fromkeys(("LOCAL_POSITION_NED", "ODOMETRY"), 30),
    **dict.fromkeys(("ATTITUDE_TARGET", "POSITION_TARGET_LOCAL_NED", "ALTITUDE"), 10),
    **dict.fromkeys(("SERVO_OUTPUT_RAW", "VFR_HUD"), 10),
    **dict.fromkeys(("SYS_STATUS", "EXTENDED_SYS_STATE"), 5),
    "ESTIMATOR_STATUS": 1,
    **dict.fromkeys(("HOME_POSITION", "BATTERY_STATUS"), 0.4),
}


def table(stream_set="onboard"):
    return StreamTable(stream_set, OFFERED, 0)


def sent(streams, seconds, start=0):
    """How often each message is due, asked every millisecond."""
    count = Counter()
    for us in range(start, start + round(seconds * 1e6), 1000):
        if us >= streams.next_us:
            count.update(streams.take_due(us))
    return count


def test_the_on_board_link_carries_what_a_real_px4_sends():
    count = sent(table(), 20.0)
    for number, name in OFFERED.items():
        if name in MEASURED_HZ:
            assert count[number] / 20.0 == pytest.approx(MEASURED_HZ[name], rel=0.03), name


@pytest.mark.parametrize("stream_set", ["onboard", "ground"])
def test_ground_truth_comes_only_on_request(stream_set):
    streams = table(stream_set)
    assert sent(streams, 5.0)[TRUTH] == 0
    assert streams.set_interval(TRUTH, 20_000, 5_000_000)
    assert sent(streams, 5.0, 5_000_000)[TRUTH] == 250


def test_nobody_can_ask_for_more_than_a_px4_publishes():
    streams = table()
    streams.set_interval(ATTITUDE, 1, 0)
    streams.set_interval(BATTERY, 1, 0)
    count = sent(streams, 2.0)
    assert count[ATTITUDE] == pytest.approx(500, abs=2)
    assert count[BATTERY] == pytest.approx(100, abs=2)

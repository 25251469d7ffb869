import pytest
from endpoint_bench import ARM, bench, of
from pymavlink.dialects.v20 import common as mavlink

MAV = mavlink.MAVLink(None, 245, 191)
REQUEST = 512


@pytest.mark.slow
def test_heartbeats_come_at_1_hz_also_after_changes_and_requests(b):
    assert len(of(b.run(5.0), "HEARTBEAT")) == 5
    while not of(b.run(0.02), "HEARTBEAT"):
        pass
    b.client.command(ARM, 1.0)
    assert not of(b.run(0.5), "HEARTBEAT")
    b.client.command(REQUEST, 0.0)
    assert [h.base_mode & 128 for h in of(b.run(0.02), "HEARTBEAT")] == [128]
    assert [h.base_mode & 128 for h in of(b.run(1.0), "HEARTBEAT")] == [128]


def test_timesync_is_answered_at_once_with_the_time_since_boot(fresh):
    fresh.run(1.0)
    fresh.client.send(MAV.timesync_encode(0, 123_456_789))
    answers = [m for m in of(fresh.run(0.004), "TIMESYNC") if m.tc1]
    assert [m.ts1 for m in answers] == [123_456_789]
    assert answers[0].tc1 == pytest.approx(fresh.boot_ns, abs=50_000_000)


def test_the_opening_of_qgroundcontrol():
    """Heartbeat, version, modes, metadata, parameters, plan, then the streams."""
    with bench("ground") as b:
        b.settle()
        b.client.mav.srcSystem, b.client.mav.srcComponent = 255, 190
        mav = b.client.mav
        b.client.send(mav.heartbeat_encode(6, 8, 0, 0, 4))
        for number, result in ((148, 0), (300, 2), (435, 2), (397, 3), (395, 3), (280, 2)):
            b.client.command(REQUEST, float(number), target=(1, 1))
            ack = b.wait("COMMAND_ACK", command=REQUEST)
            assert (ack.result, ack.target_system) == (result, 255), number
        b.client.send(mav.param_request_list_encode(1, 0))
        values = of(b.run(1.0), "PARAM_VALUE")
        assert {v.param_index for v in values} == set(range(values[0].param_count))
        for kind in range(3):
            b.client.send(mav.mission_request_list_encode(1, 1, kind))
            count = b.wait("MISSION_COUNT")
            assert (count.count, count.mission_type) == (0, kind)
        b.client.send(mav.request_data_stream_encode(1, 1, 0, 4, 1))
        assert {m.get_type() for m in b.run(3.0)} >= {
            "HEARTBEAT", "SYS_STATUS", "BATTERY_STATUS", "HOME_POSITION", "GPS_RAW_INT",
            "GLOBAL_POSITION_INT", "ATTITUDE", "VFR_HUD", "EXTENDED_SYS_STATE",
        }  # fmt: skip
        assert b.endpoint.refused["REQUEST_DATA_STREAM is not used"] == 1

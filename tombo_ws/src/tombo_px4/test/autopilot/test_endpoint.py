from types import SimpleNamespace

import pytest
from endpoint_bench import ARM, bench, of
from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link import event_definitions
from tombo_px4.protocol import words
from tombo_px4.protocol.words import PROBLEMS, Announcer

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


def test_it_asks_for_the_time_on_the_on_board_link_only():
    with bench("onboard", "ground") as b:
        b.run(1.0)
        requests = [[m for m in of(c.seen, "TIMESYNC") if not m.tc1] for c in b.clients]
    assert [len(r) for r in requests] == [10, 0]
    assert len({m.ts1 for m in requests[0]}) == 10


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
        assert b.endpoint.announcer.refused["REQUEST_DATA_STREAM is not used"] == 1
        assert (255, 190) in b.endpoint.heard_systems


def test_texts_come_where_a_ground_station_is_heard_and_events_everywhere():
    with bench("onboard", "ground", EKF2_GPS_CTRL=0, SYS_HAS_GPS=0) as b:
        b.station = False
        b.run(3.0)
        onboard, ground = b.clients
        ground.send(ground.mav.heartbeat_encode(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4))
        onboard.send(onboard.mav.heartbeat_encode(18, 8, 0, 0, 4))
        b.run(0.1)
        assert b.acks(ARM, 1.0) == [1]
        assert not of(onboard.seen, "STATUSTEXT")
        (denial,) = [m for m in of(ground.seen, "STATUSTEXT") if "Arming denied" in m.text]
        assert denial.chunk_seq == 0 and len(denial.text) == 50, (
            "its tabulator is in the next piece"
        )
        denied = 16910493  # as in the file of events of PX4 1.17
        for client in b.clients:
            assert denied in [m.id for m in of(client.seen, "EVENT")]
        b.run(3.0)
        ground.seen.clear()
        b.endpoint.say(4, "nobody is there any more")
        b.run(0.1)
        assert not of(ground.seen, "STATUSTEXT")


def test_the_bridge_knows_every_event_by_the_number_and_the_arguments_of_px4():
    """Numbers recorded from PX4's build against hashes of the names that the bridge knows."""
    tables = (words.TEXTS, words.BEGINNINGS, PROBLEMS)
    for text, event in ((t, e) for table in tables for t, e in table.items()):
        known = event_definitions.KNOWN_NUMBERS[event.number]
        assert known.format == f"<{event.kinds}", text
        assert known.names_modes == (text in PROBLEMS), text
    for event, name in (
        (words.CHECKS_BEGIN, event_definitions.CHECKS_BEGIN),
        (words.CHECKS_END, event_definitions.CHECKS_END),
    ):
        assert event.number == event_definitions.event_number(name)


def test_a_check_of_hold_does_not_stand_in_the_way_of_offboard():
    sent = []
    sender = Announcer([SimpleNamespace(link=SimpleNamespace(send=sent.append))])
    problem = "Navigation error: No valid global position estimate"
    sender.report_checks((problem,), 0)
    (modes,) = [
        int.from_bytes(bytes(event.arguments[:4]), "little")
        for event in sent
        if event.id == PROBLEMS[problem].number
    ]
    hold, offboard = 1 << 4, 1 << 14  # as in PX4's navigation_state_t
    assert modes & hold and not modes & offboard

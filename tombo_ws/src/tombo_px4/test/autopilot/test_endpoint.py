import struct
from types import SimpleNamespace

import pytest
from endpoint_bench import ARM, Client, bench, of, texts
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mavlink_packets import frame_with
from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link import event_definitions
from tombo_px4.link.message_decoder import StatusTextAssembler
from tombo_px4.protocol import statustext
from tombo_px4.protocol.statustext import PROBLEMS, StatusTextSender

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
    """Heartbeat, version, modes, metadata, parameters with their hash, plan, then home."""
    with bench("ground") as b:
        b.settle()
        b.client.mav.srcSystem, b.client.mav.srcComponent = 255, 190
        mav = b.client.mav
        b.client.send(mav.heartbeat_encode(6, 8, 0, 0, 4))
        for number, result in ((148, 0), (300, 0), (435, 2), (397, 3), (395, 3), (280, 2)):
            b.client.command(REQUEST, float(number), target=(1, 1))
            ack = b.wait("COMMAND_ACK", command=REQUEST)
            assert (ack.result, ack.target_system) == (result, 255), number
        assert of(b.client.seen, "AUTOPILOT_VERSION")
        b.client.send(mav.param_request_list_encode(1, 0))
        values = of(b.run(1.0), "PARAM_VALUE")
        assert values[0].param_id == "_HASH_CHECK"
        assert {v.param_index for v in values[1:]} == set(range(values[0].param_count))
        for kind in range(3):
            b.client.send(mav.mission_request_list_encode(1, 1, kind))
            count = b.wait("MISSION_COUNT")
            assert (count.count, count.mission_type) == (0, kind)
        b.client.send(mav.log_request_list_encode(1, 1, 0, 0xFFFF))
        assert b.wait("LOG_ENTRY").num_logs == 0
        b.client.send(mav.ping_encode(77, 1, 0, 0), mav.request_data_stream_encode(1, 1, 0, 4, 1))
        ping = b.wait("PING")
        assert (ping.time_usec, ping.target_system, ping.target_component) == (77, 255, 190)
        assert b.endpoint.statustext.counts["REQUEST_DATA_STREAM is not used"] == 1
        assert (255, 190) in b.endpoint.message_router.heard_systems
        assert {m.get_type() for m in b.run(3.0)} >= {
            "HEARTBEAT", "SYS_STATUS", "BATTERY_STATUS", "HOME_POSITION", "GPS_RAW_INT",
            "GLOBAL_POSITION_INT", "ATTITUDE", "ALTITUDE", "VFR_HUD", "EXTENDED_SYS_STATE",
        }  # fmt: skip


@pytest.mark.parametrize(
    ("message", "result"),
    [
        (MAV.mission_count_encode(1, 1, 3, 0), mavlink.MAV_MISSION_ERROR),
        (MAV.mission_count_encode(1, 1, 0, 0), mavlink.MAV_MISSION_ACCEPTED),
        (MAV.mission_clear_all_encode(1, 1, 1), mavlink.MAV_MISSION_ACCEPTED),
        (MAV.mission_request_int_encode(1, 1, 4, 2), mavlink.MAV_MISSION_INVALID_SEQUENCE),
        (MAV.mission_write_partial_list_encode(1, 1, 0, 3), mavlink.MAV_MISSION_ERROR),
    ],
)
def test_a_plan_is_not_taken_and_the_client_is_told(message, result, fresh):
    fresh.client.send(message)
    ack = fresh.wait("MISSION_ACK")
    assert ack.type == result
    assert ack.mission_type == getattr(message, "mission_type", 0)
    assert (ack.target_system, ack.target_component) == (245, 191)


@pytest.mark.parametrize(
    ("operation", "answer", "data"),
    [(4, 129, b"\x0a"), (3, 129, b"\x0a"), (77, 129, b"\x07"), (1, 128, b""), (2, 128, b"")],
)
def test_there_are_no_files(operation, answer, data):
    request = struct.pack("<HBBBBBBI", 65535, 0, operation, 9, 0, 0, 0, 0) + b"@PARAM/x "
    with bench() as b:
        payload = list(request.ljust(251, b"\x00"))
        b.client.send(MAV.file_transfer_protocol_encode(0, 1, 1, payload))
        reply = b.wait("FILE_TRANSFER_PROTOCOL")
    sequence, _, opcode, size, asked = struct.unpack_from("<HBBBB", bytes(reply.payload))
    assert (sequence, opcode, asked) == (0, answer, operation)
    assert bytes(reply.payload)[12 : 12 + size] == data


def test_an_answer_of_a_file_server_is_not_answered(fresh):
    payload = list(struct.pack("<HBBBBBBI", 1, 0, 128, 0, 4, 0, 0, 0).ljust(251, b"\x00"))
    fresh.client.send(MAV.file_transfer_protocol_encode(0, 1, 1, payload))
    assert not of(fresh.run(0.1), "FILE_TRANSFER_PROTOCOL")


def test_sticks_are_ignored_politely(fresh):
    fresh.each_round = lambda: fresh.client.send(MAV.manual_control_encode(1, 0, 0, 500, 0, 0))
    assert texts(fresh.run(1.0)) == ["MANUAL_CONTROL ignored: no manual modes here"]


def test_the_origin_of_the_map_is_told_when_somebody_sets_one(b):
    b.client.send(MAV.set_gps_global_origin_encode(1, 1, 2, 3))
    origin = b.wait("GPS_GLOBAL_ORIGIN")
    assert origin.latitude == pytest.approx(1e7 * b.endpoint.origin.latitude_deg, abs=1)


def test_messages_with_its_own_ids_are_ignored(fresh):
    fresh.client.mav.srcSystem = fresh.client.mav.srcComponent = 1
    fresh.settle()
    assert fresh.acks(ARM, 1.0) == []
    assert any("own ids" in t for t in texts(fresh.client.seen))


@pytest.fixture
def other(fresh):
    """A second client of the link."""
    made = Client(200, 1)
    made.there = fresh.client.there
    yield made
    made.socket.close()


@pytest.mark.slow
def test_telemetry_stays_with_who_spoke_first_until_it_has_gone(fresh, other):
    def counts(seconds):
        other.collect(), fresh.client.collect()
        other.seen.clear(), fresh.client.seen.clear()
        fresh.run(seconds)
        other.collect()
        return len(of(fresh.client.seen, "ATTITUDE")), len(of(other.seen, "ATTITUDE"))

    assert counts(0.5) == (50, 0)  # nobody has spoken: to where it was told to send
    fresh.client.command(31000)
    fresh.run(0.1)
    other.command(31000)
    assert counts(0.5) == (50, 0)
    fresh.run(5.0)
    other.command(31000)
    fresh.run(0.1)
    assert counts(0.5) == (0, 50)
    fresh.run(5.0)
    assert counts(0.5) == (50, 0)


@pytest.mark.slow
def test_the_work_of_one_call_is_bounded_and_all_streams_go_on_in_a_flood():
    with bench("onboard", "ground") as b:
        b.settle()
        flooder = Client(99, 99)
        flooder.there = b.links[0].address
        bad = MAV.set_position_target_local_ned_encode(0, 1, 1, 77, 0, *11 * [0.0]).pack(
            flooder.mav
        )

        def flood():
            for _ in range(200):  # 50 000 a second, twice what one call takes
                flooder.send_bytes(bad)

        try:
            b.each_round = flood
            b.clients[1].seen.clear()
            b.run(0.5)
            assert b.links[0].counters["received"] <= 100 * 126 + 10
            assert b.vehicle.tick * 1_000_000 == b.boot_ns
            assert len(of(b.clients[1].seen, "ATTITUDE")) == 10
            assert len(texts(b.clients[1].seen)) == 1
            b.each_round = None
            b.client.command(31000)  # waits behind what is left of the flood
            b.wait("COMMAND_ACK", 3.0, command=31000)
        finally:
            flooder.socket.close()


def test_texts_are_no_more_than_people_can_read(fresh):
    for k in range(1000):
        fresh.endpoint.say(4, f"text {k}")
    assert 30 <= len(of(fresh.run(0.004), "STATUSTEXT")) <= 50
    fresh.run(2.0)
    fresh.endpoint.say(4, "again")
    assert texts(fresh.run(0.004)) == ["again"]


@pytest.mark.slow
@given(st.text(max_size=400))
@example("x" * 50)
@example("x" * 100)
@example("x" * 300)
def test_a_long_text_comes_in_pieces_that_fit_together(text):
    joiner = StatusTextAssembler()
    reply = None
    for message in StatusTextSender([]).messages(MAV, 4, text):
        (sent,) = mavlink.MAVLink(None).parse_buffer(message.pack(MAV))
        assert reply is None
        reply = joiner.take(sent.severity, sent.text, sent.id, sent.chunk_seq, 0)
    if reply is None:  # PX4 does not end a text that fills its last piece
        (reply,) = joiner.take_expired(2 * 10**9)
    plain = text.encode("ascii", "replace")[:300].decode().split("\x00")[0]
    if "\x00" not in text:
        assert reply is not None
        whole = "".join(c if c.isprintable() else " " for c in plain).strip()
        assert reply.text.removesuffix("…").strip() == whole


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
    tables = (statustext.TEXTS, statustext.BEGINNINGS, PROBLEMS)
    for text, event in ((t, e) for table in tables for t, e in table.items()):
        known = event_definitions.KNOWN_NUMBERS[event.number]
        assert known.format == f"<{event.kinds}", text
        assert known.names_modes == (text in PROBLEMS), text
    for event, name in (
        (statustext.CHECKS_BEGIN, event_definitions.CHECKS_BEGIN),
        (statustext.CHECKS_END, event_definitions.CHECKS_END),
    ):
        assert event.number == event_definitions.event_number(name)


def test_a_check_of_hold_does_not_stand_in_the_way_of_offboard():
    sent = []
    sender = StatusTextSender([SimpleNamespace(send=sent.append)])
    problem = "Navigation error: No valid global position estimate"
    sender.report_checks((problem,), 0)
    (modes,) = [
        int.from_bytes(bytes(event.arguments[:4]), "little")
        for event in sent
        if event.id == PROBLEMS[problem].number
    ]
    hold, offboard = 1 << 4, 1 << 14  # as in PX4's navigation_state_t
    assert modes & hold and not modes & offboard


LETTERS = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i",
    "uint32_t": "I", "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d", "char": "c",
}  # fmt: skip
KINDS = sorted(
    (kind for kind in mavlink.mavlink_map.values() if kind.__module__ == mavlink.__name__),
    key=lambda kind: kind.id,
)
"""All messages of the dialect, without those that the suite adds."""
USED = [
    kind
    for kind in KINDS
    if kind.msgname.startswith(
        ("COMMAND_", "SET_", "PARAM_", "VISION_POS", "ODOMETRY", "ATT_POS", "TIMESYNC", "MISSION",
         "FILE_", "LOG_", "PING", "MANUAL", "RC_CHANNELS", "HEARTBEAT")
    )
]  # fmt: skip


def content(kind, data):
    """Drawn bytes for all fields of a message, but addressed to the vehicle."""
    raw = bytearray(data.draw(st.binary(min_size=kind.unpacker.size, max_size=kind.unpacker.size)))
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    names = kind.ordered_fieldnames
    sizes = [
        max(count, 1) * struct.calcsize(LETTERS[types[name]])
        for name, count in zip(names, kind.array_lengths, strict=True)
    ]
    assert sum(sizes) == len(raw)
    for name in {"target_system", "target_component"} & set(names):
        raw[sum(sizes[: names.index(name)])] = 1
    return bytes(raw)


@pytest.fixture(scope="module")
def fuzzed():
    with bench("onboard", "ground") as b:
        b.settle()
        yield b


@pytest.mark.slow
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_content_of_any_message_does_harm(fuzzed, data):
    b = fuzzed
    before = b.links[0].counters["received"]
    for kind in (data.draw(st.sampled_from(USED)), data.draw(st.sampled_from(KINDS))):
        b.client.send_bytes(frame_with(kind.id, content(kind, data), 245, 191))
    b.run(0.008)
    assert b.links[0].counters["received"] == before + 2
    assert b.vehicle.tick * 1_000_000 == b.boot_ns


@pytest.mark.slow
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from([400, 176, 22, 21, 20, 17, 192, 178, 179, 185, 300, 401, 246, 511, 510, 512]),
    st.lists(st.floats(width=32), min_size=7, max_size=7),
)
def test_no_parameter_of_any_command_does_harm(fuzzed, number, params):
    assert all(0 <= result <= 8 for result in fuzzed.acks(number, *params))

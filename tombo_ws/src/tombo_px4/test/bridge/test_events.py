"""PX4's words where it withholds its texts: events, and the file that explains them."""

import json
import lzma
import struct

import numpy as np
import pytest
from bridge_flight import NOW, Flight
from pymavlink.dialects.v20 import common as mav

from modified_px4 import DENIED, ModifiedPx4
from tombo_dynamics.messages import Phase
from tombo_px4.bridge.bridge import Bridge
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.bridge_records import SessionStage
from tombo_px4.link.event_definitions import BadMetadata, definitions, events_file, unpacked
from tombo_px4.link.extra_messages import COMPONENT_METADATA, ComponentMetadata
from tombo_px4.link.link_params import LinkParams
from tombo_px4.link.mavlink_link import Codec

# numbers as in the file of events of PX4 1.17
NO_POSITION, NO_STICKS, CPU, DISARMED_BY = 30612409, 17231145, 17836172, 32794487
OFFBOARD_MODES, MANUAL_MODES = 1 << 14, 0b111


FTP = struct.Struct("<HBBBBBBI")


class FilingPx4(ModifiedPx4):
    """A PX4 that serves files by MAVLink FTP, and loses some of its answers."""

    def __init__(self, files=None, loses=False):
        self.files, self.loses = files or {}, loses
        self._content, self._rng = b"", np.random.default_rng(3)
        super().__init__(NOW)

    def take(self, message, now_ns):
        asks = getattr(message, "command", 0) == mav.MAV_CMD_REQUEST_MESSAGE
        if message.get_type() == "FILE_TRANSFER_PROTOCOL":
            self._file(bytes(message.payload))
        elif self.files and asks and message.param1 == COMPONENT_METADATA:
            self.send(ComponentMetadata(0, 0, b"mftp://etc/general.json.xz"))
        else:
            super().take(message, now_ns)

    def _file(self, payload):
        sequence, _, operation, size, _, _, _, offset = FTP.unpack_from(payload)
        data, answer, back = payload[FTP.size : FTP.size + size], 128, b""
        if self.loses and self._rng.random() < 0.3:
            return
        if operation == mav.MAV_FTP_OPCODE_OPENFILERO:
            self._content = self.files.get(data.decode(), b"")
            answer, back = (128, struct.pack("<I", len(self._content)))
            if not self._content:
                answer, back = 129, b"\x0a"
        elif operation == mav.MAV_FTP_OPCODE_READFILE:
            back = self._content[offset : offset + size]
            answer, back = (128, back) if back else (129, b"\x06")
        head = FTP.pack((sequence + 1) % 65536, 0, answer, len(back), operation, 0, 0, offset)
        content = (0, 245, 191, list((head + back).ljust(251, b"\0")))
        self.send(mav.MAVLink_file_transfer_protocol_message(*content))


def flight_with(*files_and_loses):
    flight = Flight()
    flight.px4 = FilingPx4(*files_and_loses)
    return flight


def events_json():
    """A file of events as PX4's, small."""
    check = [{"name": "modes", "type": "modes_t"}, {"name": "component", "type": "uint8_t"}]

    def one(number, name, message, arguments=()):
        return {
            str(number & 0xFFFFFF): {
                "name": name,
                "message": message,
                "arguments": list(arguments),
            }
        }

    checks = {
        **one(NO_POSITION, "check_modes_local_pos", "Navigation error: no position", check),
        **one(CPU, "check_cpu", "load {3:.1}\\<<b>%</b>", [*check, {"type": "float"}]),
    }
    default = {
        **one(DENIED, "denied", "Arming denied: see the failures"),
        **one(DISARMED_BY, "disarmed", "Disarmed by {1}", [{"type": "px4::reason_t"}]),
    }
    enums = {
        "modes_t": {"type": "uint32_t", "is_bitfield": True, "entries": {}},
        "reason_t": {
            "type": "uint8_t",
            "entries": {"6": {"name": "land", "description": "landing"}},
        },
    }
    groups = {"arming_check": {"events": checks}, "default": {"events": default}}
    space = {"namespace": "px4", "enums": enums, "event_groups": groups}
    return {"version": 2, "components": {"1": space}}


def files(events=None):
    general = {"metadataTypes": [{"type": 4, "uri": "mftp://etc/events.json.xz"}]}
    content = json.dumps(events_json() if events is None else events).encode()
    return {
        "etc/general.json.xz": lzma.compress(json.dumps(general).encode()),
        "etc/events.json.xz": lzma.compress(content.ljust(3000)),
    }


def texts(flight):
    return [text.text for text in flight.seen["texts"]]


def test_an_event_is_decoded_from_its_bytes():
    """The frame is made here, from MAVLink's definition; 160 is the extra byte of its checksum."""
    payload = struct.pack("<IIHBBB", DENIED, 1234, 7, 0, 0, 0x22) + b"\x01"
    head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 0, 1, 1, 410, 0)
    checksum = mav.x25crc(head[1:] + payload + bytes([160])).crc
    frame = head + payload + struct.pack("<H", checksum)
    codec = Codec(1, 1)
    (message,) = codec.feed(frame, whole=True)
    assert message.get_type() == "EVENT"
    assert (message.id, message.sequence, message.log_levels) == (DENIED, 7, 0x22)
    assert bytes(message.arguments) == b"\x01".ljust(40, b"\0")
    assert codec.counters["unknown_message"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("loses", [False, True])
def test_a_denied_arming_says_why_in_px4s_own_words(loses):
    flight = flight_with(files(), loses)
    flight.px4.failing = [(NO_POSITION, 0x23, OFFBOARD_MODES)]
    flight.px4.report_checks()  # before the first heartbeat
    flight.run(30.0 if loses else 3.0)
    assert texts(flight)[0] == "Preflight Fail: Navigation error: no position", "it has waited"
    assert flight.bridge.words.metadata.over and not flight.bridge.words.metadata.failed
    flight.px4.refuses[400] = 1
    flight.px4.failing = [
        (NO_POSITION, 0x23, OFFBOARD_MODES | MANUAL_MODES),
        (NO_STICKS, 0x23, MANUAL_MODES),
    ]
    flight.phase = Phase.TAKEOFF
    flight.stage(SessionStage.GIVEN_UP, 20.0)
    assert "Arming denied: see the failures" in flight.out.status.why
    assert "Preflight Fail: Navigation error: no position" in flight.out.status.why
    assert "remote control" not in flight.out.status.why, "stands in no way of OFFBOARD"


@pytest.mark.slow
def test_where_nothing_explains_them_there_are_words_of_our_own_and_numbers():
    flight = Flight()
    flight.px4.failing = [(NO_POSITION, 0x23, OFFBOARD_MODES)]
    flight.run(5.0)
    assert flight.bridge.words.metadata.failed
    assert "Preflight Fail: no valid position" in texts(flight), "asked for at the start"
    flight.px4.tell(1 << 24 | 77, 0x33, ("B", 5), ("H", 258))
    flight.px4.tell(1 << 24 | 78, 0x37)  # debug: for nobody
    flight.run(0.1)
    assert texts(flight)[-1] == "event 16777293 of component 1, arguments 05 02 01"


@pytest.mark.slow
def test_texts_come_where_the_bridge_is_a_ground_station_and_once():
    onboard, station = flight_with(files()), flight_with(files())
    station.bridge = Bridge(BridgeParams(), LinkParams(heartbeat_type="gcs"), 1.3)
    for flight in (onboard, station):
        flight.run(3.0)
        flight.px4.say("Takeoff detected")
        flight.px4.say("Arming denied: Resolve system health failures first\t", 2)
        flight.px4.tell(DENIED, 0x22)
        flight.run(1.5)
    assert texts(onboard)[-1] == "Arming denied: see the failures"
    assert "Takeoff detected" not in texts(onboard)
    said = [text for text in texts(station) if not text.startswith("Preflight")]
    assert said == ["Takeoff detected", "Arming denied: see the failures"]


def test_arguments_stand_in_their_places():
    events = definitions(json.dumps(events_json()).encode())
    assert events[DISARMED_BY].text(b"\x06") == "Disarmed by landing"
    assert events[DISARMED_BY].text(b"\x09") == "Disarmed by 9"
    assert events[CPU].text(struct.pack("<IBf", 0, 0, 97.26)) == "load 97.3<%"
    assert events[CPU].names_modes and not events[DISARMED_BY].names_modes


@pytest.mark.slow
@pytest.mark.parametrize(
    "content",
    [
        b"\xff\xfe no JSON",
        b"[" * 200_000,
        b'{"components": {"1": {"event_groups": 5, "enums": [3]}}}',
        b'{"components": {"1": {"event_groups": {"a": {"events": {"x": 1, "9": []}}}}}}',
        lzma.compress(b" " * (9 << 20)),
        lzma.compress(b"{}" * 500)[:-40],
        b"1" * 5000,
    ],
)
def test_metadata_that_are_none_are_given_up(content):
    flight = flight_with(files() | {"etc/events.json.xz": content})
    flight.run(8.0)
    words = flight.bridge.words
    assert words.metadata.over
    assert not any(number >> 24 == 1 and number != 1 << 24 | 9 for number in words.metadata.events)
    flight.px4.tell(DENIED, 0x22)
    flight.run(0.1)
    assert texts(flight)[-1] == "arming denied: a check fails"


def test_files_that_are_not_on_the_vehicle_are_not_read():
    for uri in ("https://example.org/a.json", "", 5):
        assert events_file(json.dumps({"metadataTypes": [{"type": 4, "uri": uri}]}).encode()) == ""
    with pytest.raises(BadMetadata):
        unpacked(b"\xfd7zXZ\x00" + b"rubbish" * 9)

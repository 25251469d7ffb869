import signal
import socket
import time

import pytest
from px4_process import px4_process, read_until
from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.bridge.vehicle_parameters import EV_DELAY, FLIGHT_PARAMETERS


def listen(port):
    """A socket that a client would listen on."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.settimeout(60.0)
    sock.bind(("127.0.0.1", port))
    return sock


def first(sock, kind):
    """The first message of a kind, and the port it came from."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        data, sender = sock.recvfrom(2048)
        for message in parser.parse_buffer(data) or []:
            if message.get_type() == kind:
                return message, sender[1]
    raise AssertionError(f"no {kind}")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_speaks_to_both_ports_and_stops_well_when_it_is_asked_to(number):
    with px4_process() as px4:
        with listen(px4.port) as board, listen(px4.ground_port) as ground:
            for sock, own in ((board, px4.port + 40), (ground, px4.port + 4030)):
                beat, sender = first(sock, "HEARTBEAT")
                assert sender == own
                assert beat.autopilot == mavlink.MAV_AUTOPILOT_PX4
                assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 1)
        px4.process.send_signal(number)
        lines = read_until(px4.process, "stopped after")
        assert px4.process.wait(timeout=60.0) == 0
        assert not any("Traceback" in line for line in lines)


@pytest.mark.slow
def test_only_who_has_the_key_is_heard(tmp_path):
    key = tmp_path / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    with px4_process("--key", str(key)) as px4, listen(px4.port) as board:
        beat, sender = first(board, "HEARTBEAT")
        assert beat.get_msgbuf()[2] & mavlink.MAVLINK_IFLAG_SIGNED
        mav = mavlink.MAVLink(None, 245, 191)
        for signed in (False, True):
            if signed:
                mav.signing.secret_key = key.read_bytes()
                mav.signing.sign_outgoing = True
                mav.signing.timestamp = int((time.time() - 1420070400) * 1e5)
            board.sendto(mav.command_long_encode(1, 1, 31000, 0, *7 * [0.0]).pack(mav),
                         ("127.0.0.1", sender))  # fmt: skip
            if not signed:
                deadline = time.monotonic() + 0.5
                while time.monotonic() < deadline:
                    assert mavlink.MAVLink(None).parse_buffer(board.recv(2048))
        ack, _ = first(board, "COMMAND_ACK")
        assert ack.command == 31000


def test_the_parameter_file_has_what_a_flight_needs(tombo, refused, tmp_path):
    assert tombo("px4", "--write-params", "lab.params").code == 0
    text = (tmp_path / "lab.params").read_text()
    rows = [line.split("\t") for line in text.splitlines() if not line.startswith("#")]
    values = {name: (float(value), int(kind)) for _, _, name, value, kind in rows}
    for parameter in FLIGHT_PARAMETERS:
        if parameter.accepts is not None and parameter.name != EV_DELAY:
            assert parameter.accepts(values[parameter.name][0]), parameter.name
            assert f"# {parameter.name}: " in text
    assert values["COM_OF_LOSS_T"][1] == mavlink.MAV_PARAM_TYPE_REAL32
    assert values["COM_OBL_RC_ACT"][1] == mavlink.MAV_PARAM_TYPE_INT32
    refused(("px4", "--write-params", "lab.params"), "'lab.params' exists")

"""The link: URLs, whole frames of the right ones come in, nothing else gets in or stops it."""

import contextlib
import os
import socket
import struct
import subprocess
import sys
import termios
import time

import pytest
from mavlink_packets import encoder, heartbeat

from tombo_dynamics.errors import InputError
from tombo_px4.link.mavlink_link import (
    COUNTED,
    Codec,
    Link,
    check_key,
    open_transport,
    parse_url,
    read_key,
    timestamp_of,
)

KEY = bytes(range(1, 33))
OTHER_KEY = bytes(range(2, 34))
VEHICLE = {"system": 1, "component": 1}
COMPUTER = {"system": 245, "component": 191}
NOW_NS = 1_800_000_000 * 10**9
NOW = timestamp_of(NOW_NS)


def modes(messages):
    return [message.custom_mode for message in messages]


def unknown(size=9, number=54321, signed=False):
    """A frame of a message that the dialect does not know, as PX4's own dialect has some."""
    flags = 1 if signed else 0
    head = struct.pack("<BBBBBBBHB", 0xFD, size, flags, 0, 0, 1, 1, number & 0xFFFF, number >> 16)
    return head + bytes(size + 2 + (13 if signed else 0))


# ---- frames


@pytest.mark.parametrize(
    ("data", "delivered", "counts"),
    [
        (
            b"noise" + heartbeat(1) + b"..." + heartbeat(2) + heartbeat(3) + b"end",
            [1, 2, 3],
            {"garbage_bytes": 11},
        ),
        *(
            (
                heartbeat(1) + unknown(size, signed=signed) + heartbeat(2) + unknown(size),
                [1, 2],
                {"unknown_message": 2},
            )
            for size in (0, 9, 255)
            for signed in (False, True)
        ),
    ],
)
def test_frames_are_found_behind_what_is_none(data, delivered, counts):
    """A message of another dialect is passed over."""
    codec = Codec(1, 1)
    assert modes(codec.feed(data, whole=True)) == delivered
    assert {name: n for name, n in codec.counters.items() if n} == counts


def test_a_flipped_bit_lets_no_wrong_message_in():
    """Where it changes the length, it also costs what the damaged header claims."""
    good = heartbeat(1)
    for position in range(len(good)):
        for bit in range(8):
            bad = bytearray(heartbeat(2))
            bad[position] ^= 1 << bit
            codec = Codec(1, 1)
            delivered = modes(codec.feed(good + bytes(bad) + heartbeat(3), whole=True))
            changes_length = position in (0, 1, 2)
            assert delivered in ([[1], [1, 3]] if changes_length else [[1, 3]]), (position, bit)
            assert codec.counters["garbage_bytes"] + codec.counters["unknown_message"] > 0


def test_the_environment_cannot_switch_the_checksum_off():
    program = (
        "from tombo_px4.link.mavlink_link import Codec; codec = Codec(1, 1);"
        f"assert not codec.feed({heartbeat(1)[:-1] + b'!'!r}, True), 'a wrong checksum'"
    )
    environment = {**os.environ, "MAVLINK_IGNORE_CRC": "1"}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)


# ---- signatures


def signing(now_ns=NOW_NS):
    codec = Codec(245, 191)
    codec.set_key(KEY, 0, now_ns)
    return codec


def signed(timestamp, key=KEY, system=1, component=1, link_id=0):
    mav = encoder(system, component, key)
    mav.signing.timestamp = timestamp
    mav.signing.link_id = link_id
    return heartbeat(1, mav)


def refusal(codec, frame):
    """Return the counter that a frame raises, "" if it is let in."""
    before = dict(codec.counters)
    if codec.feed(frame, whole=True):
        return ""
    (raised,) = (name for name, count in codec.counters.items() if count > before[name])
    return raised


def test_a_changed_signature_time_or_key_is_refused():
    frame = signed(NOW + 1)
    for position in range(len(frame) - 13, len(frame)):
        bad = bytearray(frame)
        bad[position] ^= 0x10
        assert refusal(signing(), bytes(bad)) == "bad_signature", position
    assert refusal(signing(), signed(NOW + 1, OTHER_KEY)) == "bad_signature"
    assert refusal(signing(), heartbeat(1)) == "unsigned"
    assert refusal(signing(), heartbeat(1, old=True)) == "unsigned"


def test_every_sender_and_link_has_timestamps_and_each_counts_once():
    codec = signing()
    assert refusal(codec, signed(NOW + 9)) == ""
    for other in ({}, {"system": 2}, {"component": 2}, {"link_id": 2}):
        assert refusal(codec, signed(NOW + 3, **other)) == ("" if other else "replayed")
        assert refusal(codec, signed(NOW + 3, **other)) == "replayed"


def test_a_recording_is_refused_and_a_forged_time_shuts_nobody_out():
    codec = signing()
    assert refusal(codec, signed(NOW - 1)) == "replayed"
    assert refusal(codec, signed(2**48 - 1, OTHER_KEY)) == "bad_signature"
    assert refusal(codec, signed(NOW)) == ""
    assert codec.signing.timestamp == NOW


def test_a_partner_whose_clock_is_behind_takes_over_our_time():
    """pymavlink plays the partner: by the protocol it continues from the newest it has heard."""
    codec = signing()
    partner = encoder(1, 1, KEY)
    partner.signing.timestamp = timestamp_of(NOW_NS - 3600 * 10**9)
    assert refusal(codec, heartbeat(1, partner)) == "replayed"
    partner.decode(bytearray(signed(NOW, system=245)))
    partner.signing.timestamp += 1
    assert refusal(codec, heartbeat(1, partner)) == ""


@pytest.mark.parametrize("content", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"])
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o604, 0o622])
def test_a_key_is_read_as_bytes_or_digits_and_warned_of_if_others_may(tmp_path, content, mode):
    path = tmp_path / "key"
    path.write_bytes(content)
    path.chmod(mode)
    warnings = []
    assert read_key(str(path), warnings.append) == KEY
    assert [str(path) in text and "chmod 600" in text for text in warnings] == (
        [True] if mode & 0o077 else []
    )
    assert read_key("", warnings.append) is None


@pytest.mark.parametrize(
    "content",
    [b"", KEY[:-1], KEY + b"\n", bytes(32), b"0" * 64, KEY.hex().encode()[:-1], b"\xff" * 64],
)
def test_what_is_no_key_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "key"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"key '.*' is no key; accepted: a file of 32 bytes") as e:
        read_key(str(path), print)
    assert "\n" not in str(e.value)
    for missing, why in ((tmp_path / "none", "no such file"), (tmp_path, "directory")):
        with pytest.raises(InputError, match=why):
            read_key(str(missing), print)
    with pytest.raises(InputError, match="accepted"):
        check_key(b"short")


# ---- URLs


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpin://127.0.0.1:14540", ("udpin", "127.0.0.1", 14540)),
        ("udpin://localhost:0", ("udpin", "127.0.0.1", 0)),
        ("udpout://127.0.0.1:14580", ("udpout", "127.0.0.1", 14580)),
        ("tcpin://127.0.0.1:4560", ("tcpin", "127.0.0.1", 4560)),
        ("tcpout://127.0.0.2:5760", ("tcpout", "127.0.0.2", 5760)),
        ("serial:///dev/ttyACM0:57600", ("serial", "/dev/ttyACM0", 57600)),
    ],
)
def test_urls(text, url):
    assert parse_url(text, False) == url


@pytest.mark.parametrize(
    "text",
    [
        "",
        "14540",
        "udp://127.0.0.1:14540",
        "udpin://:14540",
        "udpin:127.0.0.1:14540",
        "udpin://127.0.0.1",
        "udpin://127.0.0.1:",
        "udpin://127.0.0.1:70000",
        "udpin://127.0.0.1:-1",
        "udpin://127.0.0.1:14540/x",
        "udpin://127.0.0.1:1\n",
        "udpout://127.0.0.1:0",
        "udpout://127.0.0.1:14540?local=14580",
        "udpout://:14540",
        "tcpout://:4560",
        "http://127.0.0.1:80",
        "serial://ttyACM0:57600",
        "serial:///dev/ttyACM0",
        "serial:///dev/ttyACM0:fast",
        "serial:///dev/ttyACM0:12345",
    ],
)
def test_what_is_no_url_is_refused_in_one_line(text):
    with pytest.raises(InputError, match="accepted: ") as refusal:
        parse_url(text, True)
    assert repr(text)[1:-1] in repr(str(refusal.value))


@pytest.mark.parametrize(
    "host", ["192.168.1.5", "0.0.0.0", "8.8.8.8", "127.example.org", "drone.local"]
)
@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcpin", "tcpout"])
def test_other_machines_are_refused_unless_allowed(kind, host):
    with pytest.raises(InputError, match="not to this machine; accepted: localhost, 127"):
        parse_url(f"{kind}://{host}:14540", False)


def test_other_machines_are_allowed_when_asked_for():
    assert parse_url("udpout://192.168.1.5:14540", True).place == "192.168.1.5"
    with pytest.raises(InputError, match=r"host 'no\.such\.host\.invalid' is not known"):
        parse_url("udpout://no.such.host.invalid:14540", True)


# ---- transports


class Way:
    """A transport of a test, with its counters."""

    def __init__(self, url, clock=time.time_ns):
        self.counters = dict.fromkeys(COUNTED, 0)
        self.transport = open_transport(url, clock, self.counters, False)

    def read(self, seconds=20.0, number=1):
        """Wait for packets that are not empty; return their bytes joined."""
        data = b""
        end = time.monotonic() + seconds
        while len(data) < number and time.monotonic() < end:
            packet = self.transport.read()
            if packet is None:
                time.sleep(0.001)
            else:
                data += packet.data
        return data

    def tend_until(self, condition, seconds=30.0):
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self.transport.read()
            time.sleep(0.001)
        assert condition()


@pytest.fixture
def way():
    with contextlib.ExitStack() as stack:

        def make(*args, **kwargs):
            made = Way(*args, **kwargs)
            stack.callback(made.transport.close)
            return made

        yield make


@pytest.fixture
def sockets():
    with contextlib.ExitStack() as stack:

        def make(kind=socket.SOCK_STREAM, server=None, bound=False):
            """A socket, perhaps at a port of its own or connected to a TCP server."""
            made = stack.enter_context(socket.socket(socket.AF_INET, kind))
            if bound:
                made.bind(("127.0.0.1", 0))
            if server is not None:
                made.settimeout(60.0)
                made.connect(server.transport.address)
            return made

        yield make


def free_port():
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_busy_port_is_reported_in_one_line(way, kind):
    port = way(f"{kind}://127.0.0.1:0").transport.address[1]
    with pytest.raises(InputError, match=r"address already in use.*; accepted: a free port") as e:
        way(f"{kind}://127.0.0.1:{port}")
    assert f"{kind}://127.0.0.1:{port}" in str(e.value) and "\n" not in str(e.value)


def test_a_datagram_has_the_stamp_of_the_kernel(way, sockets):
    """A kernel that stamped for nobody before begins a moment after it was asked."""
    receiver = way("udpin://127.0.0.1:0", clock=lambda: 0)
    sender = sockets(socket.SOCK_DGRAM)
    for _ in range(40):
        before = time.time_ns()
        sender.sendto(b"x", receiver.transport.address)
        after = time.time_ns()
        time.sleep(0.05)
        arrival_ns = receiver.transport.read().arrival_ns
        assert receiver.transport.read() is None
        assert arrival_ns >= before
        if arrival_ns <= after:
            return
    raise AssertionError("no stamp of the kernel")


@pytest.mark.slow
def test_a_tcp_client_keeps_trying_and_comes_back(way):
    port = free_port()
    client = way(f"tcpout://127.0.0.1:{port}")
    client.tend_until(lambda: not client.transport.connected)
    descriptor = client.transport.fileno()
    for _ in range(2):
        server = way(f"tcpin://127.0.0.1:{port}")
        client.tend_until(lambda: client.transport.connected)
        assert client.transport.write(b"hello", None) == ""
        assert server.read(number=5) == b"hello"
        assert server.transport.write(b"there", None) == ""
        assert client.read(number=5) == b"there"
        server.transport.close()
        client.tend_until(lambda: not client.transport.connected)
        assert client.transport.write(b"x", None) == "no_peer"
    assert client.transport.fileno() == descriptor


def test_a_tcp_server_has_one_client_and_turns_others_away(way, sockets):
    server = way("tcpin://127.0.0.1:0")
    assert server.transport.write(b"x", None) == "no_peer"
    partner = sockets(server=server)
    server.tend_until(lambda: server.transport.connected)
    late = sockets(server=server)
    server.tend_until(lambda: server.counters["dropped"] == 1)
    assert late.recv(9) == b""
    assert server.transport.write(b"!", partner.getsockname()) == ""
    assert server.transport.write(b"!", None) == ""
    assert partner.recv(1) + partner.recv(1) == b"!!"
    assert server.transport.write(b"4", ("127.0.0.1", 1)) == "no_peer"
    partner.close()
    again = sockets(server=server)  # of a partner that was restarted
    again.sendall(b"again")
    assert server.read(number=5) == b"again"
    assert server.transport.opened == 2


@pytest.mark.slow
def test_a_tcp_client_that_does_not_read_costs_whole_frames_only(way, sockets):
    server = way("tcpin://127.0.0.1:0")
    client = sockets()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.connect(server.transport.address)
    client.sendall(b"?")
    server.read()
    frame = bytes(range(250))
    results = [server.transport.write(frame, None) for _ in range(40_000)]
    assert set(results) == {"", "send_failed"}
    accepted = results.count("")
    client.settimeout(0.02)
    data = bytearray()
    end = time.monotonic() + 60.0
    while len(data) < accepted * len(frame) and time.monotonic() < end:
        with contextlib.suppress(TimeoutError):
            data += client.recv(1 << 20)
        server.transport.read()  # what waits goes out here
    assert data == frame * accepted


def test_a_lost_client_is_no_error(way, sockets):
    server = way("tcpin://127.0.0.1:0")
    client = sockets(server=server)
    client.sendall(b"?")
    server.read()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    client.close()  # a reset, as of a process that was killed
    end = time.monotonic() + 60.0
    while not server.transport.write(b"x", None):  # until the reset has come
        assert time.monotonic() < end
    assert not server.transport.connected
    assert server.transport.write(b"x", None) == "no_peer"


@pytest.fixture
def pty():
    ends = os.openpty()
    yield ends
    for end in ends:
        with contextlib.suppress(OSError):
            os.close(end)


def test_a_serial_port_is_raw_and_fast(way, pty):
    radio, port = pty
    serial = way(f"serial://{os.ttyname(port)}:921600")
    assert termios.tcgetattr(port)[4:6] == [termios.B921600] * 2
    every = bytes(range(256))  # control characters too, with no echo and no line ends
    assert serial.transport.write(every, None) == ""
    assert os.read(radio, 999) == every
    os.write(radio, every)
    assert serial.read(number=256) == every
    assert serial.transport.read() is None


@pytest.mark.slow
def test_a_serial_port_that_is_unplugged_is_tried_again(way, pty, monkeypatch):
    radio, port = pty
    serial = way(f"serial://{os.ttyname(port)}:57600")
    descriptor = serial.transport.fileno()
    os.close(port)
    os.close(radio)
    serial.tend_until(lambda: not serial.transport.connected)
    assert serial.transport.write(b"x", None) == "no_peer"
    other_radio, other_port = os.openpty()
    try:
        serial.transport._url = parse_url(f"serial://{os.ttyname(other_port)}:57600", False)
        serial.tend_until(lambda: serial.transport.connected)
        os.write(other_radio, b"back")
        assert serial.read(number=4) == b"back"
        assert serial.transport.fileno() == descriptor
    finally:
        os.close(other_radio)
        os.close(other_port)


def test_a_serial_port_that_is_none_is_refused(way, tmp_path):
    with pytest.raises(InputError, match=r"no such file.*; accepted: .*a serial device"):
        way("serial:///dev/ttyNone:57600")
    file = tmp_path / "file"
    file.write_bytes(b"")
    with pytest.raises(InputError, match="can't be opened"):
        way(f"serial://{file}:57600")


# ---- the link


@pytest.fixture
def links():
    with contextlib.ExitStack() as stack:

        def make(url, ids=VEHICLE, **kwargs):
            link = Link(url, **{"clock": time.time_ns, **ids, **kwargs})
            stack.callback(link.close)
            return link

        yield make


@pytest.fixture
def sender():
    """A bare UDP socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(60.0)
        yield sock


@pytest.fixture
def pair(links):
    """A listening vehicle and a computer that speaks to it."""

    def make(kind="udp", **kwargs):
        vehicle = links(f"{kind}in://127.0.0.1:0", **kwargs)
        computer = links(f"{kind}out://127.0.0.1:{vehicle.address[1]}", COMPUTER, **kwargs)
        end = time.monotonic() + 60.0
        while not computer.connected and time.monotonic() < end:
            computer.wait(0.01)
            computer.receive()
            vehicle.receive()
        return vehicle, computer

    return make


def beat(link, mode=0):
    return link.mav.heartbeat_encode(6, 8, 0, mode, 3)


def came(received):
    return modes(item.message for item in received)


def collect(link, number=1, seconds=2.0, limit=200):
    """Receive until there are `number` messages, or the time is over."""
    arrived = []
    end = time.monotonic() + seconds
    while len(arrived) < number and time.monotonic() < end:
        link.wait(0.02)
        arrived += link.receive(limit)
    return arrived


@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_messages_go_both_ways(pair, kind):
    vehicle, computer = pair(kind)
    assert computer.send(beat(computer, 7))
    (came,) = collect(vehicle)
    assert came.message.get_type() == "HEARTBEAT" and came.message.custom_mode == 7
    assert (came.system, came.component) == (245, 191)
    assert abs(came.arrival_ns - time.time_ns()) < 2_000_000_000
    assert vehicle.connected and computer.connected
    assert vehicle.send(vehicle.mav.timesync_encode(0, 5))
    assert vehicle.send(vehicle.mav.timesync_encode(0, 6), to=came.peer)
    answers = collect(computer, 2)
    assert [answer.message.ts1 for answer in answers] == [5, 6]
    assert [answer.message.get_seq() for answer in answers] == [0, 1]
    assert vehicle.counters["sent"] == computer.counters["received"] == 2
    assert vehicle.counters["garbage_bytes"] == computer.counters["garbage_bytes"] == 0


def test_a_default_peer_is_spoken_to_first_and_left_for_who_speaks(links, sender):
    sender.bind(("127.0.0.1", 0))
    vehicle = links("udpin://127.0.0.1:0", default_peer=f"127.0.0.1:{sender.getsockname()[1]}")
    assert vehicle.connected and vehicle.send(beat(vehicle))
    data, address = sender.recvfrom(300)
    assert data[0] == 0xFD and address == vehicle.address
    computer = links(f"udpout://127.0.0.1:{vehicle.address[1]}", COMPUTER)
    computer.send(beat(computer))
    assert collect(vehicle)
    vehicle.send(beat(vehicle))
    assert collect(computer)


@pytest.mark.parametrize(
    ("accept", "let_in", "counter"),
    [
        ({}, [(1, 1), (1, 2), (2, 1)], None),
        ({"accept_system": 1}, [(1, 1), (1, 2)], "wrong_system"),
        ({"accept_component": 1}, [(1, 1), (2, 1)], "wrong_component"),
        ({"accept_system": 1, "accept_component": 1}, [(1, 1)], "wrong_system"),
    ],
)
def test_only_the_accepted_system_and_component_come_in(links, sender, accept, let_in, counter):
    link = links("udpin://127.0.0.1:0", COMPUTER, **accept)
    for system, component in [(1, 1), (1, 2), (2, 1)]:
        sender.sendto(heartbeat(0, encoder(system, component)), link.address)
    arrived = collect(link, len(let_in))
    assert [(item.system, item.component) for item in arrived] == let_in
    if counter:
        assert link.counters[counter] == 1
        assert link.mav.rejected_sender not in (None, *let_in)
    else:
        assert link.mav.rejected_sender is None


def test_with_a_key_the_rest_is_refused_and_counted(links, sender):
    link = links("udpin://127.0.0.1:0", COMPUTER, key=KEY)
    vehicle = encoder(1, 1, KEY)
    vehicle.signing.timestamp = 2**47  # far in the future: newer than our start
    good = heartbeat(1, vehicle)
    sender.sendto(good, link.address)
    assert came(collect(link)) == [1]
    peer = link._transport.peer
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        for data in (
            good,
            heartbeat(2),
            heartbeat(2, old=True),
            heartbeat(2, encoder(key=OTHER_KEY)),
        ):
            thief.sendto(data, link.address)
        sender.sendto(heartbeat(3, vehicle), link.address)
        assert came(collect(link)) == [3]
    assert link.counters["replayed"] == 1
    assert link.counters["unsigned"] == 2
    assert link.counters["bad_signature"] == 1
    assert link._transport.peer == peer


@pytest.mark.parametrize("url", ["udpin://127.0.0.1:0", "tcpin://127.0.0.1:0"])
@pytest.mark.parametrize(
    ("wrong", "message_part"),
    [
        ({"system": 0}, "system 0 is out of bounds; accepted: 1 to 255"),
        ({"component": 256}, "component 256 is out of bounds; accepted: 1 to 255"),
        ({"accept_system": -1}, "accept_system -1"),
        ({"link_id": 256}, "link_id 256"),
        ({"key": b"short"}, "key is no key; accepted: a file of 32 bytes"),
        ({"default_peer": "nowhere"}, "nowhere"),
        ({"default_peer": "8.8.8.8:14540"}, "not to this machine"),
    ],
)
def test_wrong_arguments_are_reported_in_one_line(url, wrong, message_part):
    with pytest.raises(InputError, match=message_part) as refusal:
        Link(url, **{**VEHICLE, "clock": time.time_ns, **wrong}).close()
    assert "\n" not in str(refusal.value) and "accepted" in str(refusal.value)


def test_half_frames_over_tcp_are_put_together_and_forgotten_with_their_client(links):
    link = links("tcpin://127.0.0.1:0", COMPUTER)
    with socket.create_connection(link.address) as client:
        for byte in heartbeat(1):
            client.sendall(bytes([byte]))
            link.wait(0.01)
            collect(link, 1, 0.001)
        collect(link, 1, 0.1)
        assert (link.counters["received"], link.counters["garbage_bytes"]) == (1, 0)
        client.sendall(heartbeat(2)[:11])
        collect(link, 1, 0.05)
    with socket.create_connection(link.address) as again:
        again.sendall(heartbeat(3))
        assert came(collect(link)) == [3]


def test_a_flood_takes_a_bounded_call_and_what_was_lost_is_told(links, sender):
    link = links("udpin://127.0.0.1:0", COMPUTER, accept_system=1)
    reads = []
    read = link._transport.read
    link._transport.read = lambda: reads.append(1) or read()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        for _ in range(3000):  # more than the kernel keeps
            attacker.sendto(b"flood", link.address)
        assert link.receive(limit=10) == []
        assert len(reads) == 40
        while link.wait(0.0):
            link.receive()
        sender.sendto(heartbeat(7), link.address)  # the next message reveals the lost ones
        assert came(collect(link)) == [7]
    assert link.counters["dropped"] > 0

"""The link: URLs, whole frames of the right ones come in, nothing else gets in or stops it."""

import contextlib
import os
import socket
import struct
import termios
import time

import pytest
from mavlink_packets import encoder, heartbeat

from tombo_dynamics.errors import InputError
from tombo_px4.link.mavlink_link import (
    Codec,
    Link,
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
    with pytest.raises(InputError, match="is not a key; accepted: a file of 32 bytes") as e:
        read_key(str(path), print)
    assert "\n" not in str(e.value)
    for missing, why in ((tmp_path / "none", "no such file"), (tmp_path, "directory")):
        with pytest.raises(InputError, match=why):
            read_key(str(missing), print)


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
        "udp://127.0.0.1:14540",
        "udpin:127.0.0.1:14540",
        "udpin://127.0.0.1",
        "udpin://127.0.0.1:70000",
        "udpin://127.0.0.1:1\n",
        "udpout://127.0.0.1:0",
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


# ---- transports


class Way:
    """A transport of a test, with its counters."""

    def __init__(self, url, clock=time.time_ns):
        self.transport = open_transport(url, clock, False)

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


def is_closed(client):
    try:
        return client.recv(9) == b""
    except BlockingIOError:
        return False


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
    late.setblocking(False)
    server.tend_until(lambda: is_closed(late))
    assert server.transport.write(b"!", partner.getsockname()) == ""
    assert server.transport.write(b"!", None) == ""
    assert partner.recv(1) + partner.recv(1) == b"!!"
    assert server.transport.write(b"4", ("127.0.0.1", 1)) == "no_peer"
    partner.close()
    again = sockets(server=server)  # of a partner that was restarted
    again.sendall(b"again")
    assert server.read(number=5) == b"again"
    assert server.transport.opened == 2


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

"""Ways to the other side: URLs, who may be spoken with, TCP that comes and goes, serial ports."""

import contextlib
import os
import socket
import termios
import time

import pytest

from tombo_dynamics.errors import InputError
from tombo_px4.link import tcp, udp
from tombo_px4.link.mavlink_link import COUNTED, open_transport
from tombo_px4.link.transport import RetryTimer, is_loopback, parse_peer, parse_url


class Way:
    """A transport of a test, with what it counted."""

    def __init__(self, url, allow_remote=False, peer=None, clock=time.time_ns):
        self.counters = dict.fromkeys(COUNTED, 0)
        parsed = parse_url(url, allow_remote)
        self.transport = open_transport(parsed, clock, self.counters, allow_remote, peer)

    def read(self, seconds=20.0, number=1):
        """Wait for packets that are not empty; return their bytes joined."""
        data = b""
        end = time.monotonic() + seconds
        while len(data) < number and time.monotonic() < end:
            self.transport.maintain()
            packet = self.transport.read()
            if packet is None:
                time.sleep(0.001)
            else:
                data += packet.data
        return data

    def tend_until(self, condition, seconds=30.0):
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self.transport.maintain()
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


@pytest.mark.parametrize(
    ("text", "kind", "host", "port", "local"),
    [
        ("udpin://127.0.0.1:14540", "udpin", "127.0.0.1", 14540, 0),
        ("udp://:14540", "udpin", "127.0.0.1", 14540, 0),
        ("udpin://localhost:0", "udpin", "127.0.0.1", 0, 0),
        ("udpout://127.0.0.1:14580?local=14540", "udpout", "127.0.0.1", 14580, 14540),
        ("udpout://[::1]:14580", "udpout", "::1", 14580, 0),
        ("tcpin://127.0.0.1:4560", "tcpin", "127.0.0.1", 4560, 0),
        ("tcp://localhost:5760", "tcpout", "127.0.0.1", 5760, 0),
        ("tcpout://127.0.0.1:5760", "tcpout", "127.0.0.1", 5760, 0),
        ("serial:///dev/ttyACM0:57600", "serial", "/dev/ttyACM0", 57600, 0),
    ],
)
def test_urls(text, kind, host, port, local):
    url = parse_url(text, False)
    assert (url.kind, url.host, url.port, url.local) == (kind, host, port, local)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "14540",
        "udp",
        "udpin:127.0.0.1:14540",
        "udpin://127.0.0.1",
        "udpin://127.0.0.1:",
        "udpin://127.0.0.1:70000",
        "udpin://127.0.0.1:-1",
        "udpin://127.0.0.1:14540/x",
        "udpin://127.0.0.1:14540?local=3",
        "udpin://127.0.0.1:1\n",
        "udpout://127.0.0.1:0",
        "udpout://127.0.0.1:14540?local=99999",
        "udpout://:14540",
        "tcpout://:4560",
        "http://127.0.0.1:80",
        "serial://ttyACM0:57600",
        "serial:///dev/ttyACM0",
        "serial:///dev/ttyACM0:fast",
    ],
)
def test_what_is_no_url_is_refused_in_one_line(text):
    with pytest.raises(InputError, match="accepted: ") as refusal:
        parse_url(text, True)
    assert repr(text)[1:-1] in repr(str(refusal.value))


@pytest.mark.parametrize("host", ["192.168.1.5", "0.0.0.0", "8.8.8.8", "[::]", "drone.local"])
@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcpin", "tcpout"])
def test_other_machines_are_refused_unless_allowed(kind, host):
    with pytest.raises(InputError, match="not to this machine; accepted: localhost, 127"):
        parse_url(f"{kind}://{host}:14540", False)


def test_other_machines_are_allowed_when_asked_for():
    assert parse_url("udpout://192.168.1.5:14540", True).host == "192.168.1.5"
    assert parse_url("udp://:14540", True).host == "0.0.0.0"
    with pytest.raises(InputError, match=r"host 'no\.such\.host\.invalid' is not known"):
        parse_url("udpout://no.such.host.invalid:14540", True)


def test_a_peer_is_host_and_port():
    assert parse_peer("localhost:14540", False) == ("127.0.0.1", 14540)
    assert parse_peer("[::1]:14540", False) == ("::1", 14540)
    for text in ("14540", ":14540", "127.0.0.1:0", "127.0.0.1:x", "8.8.8.8:14540"):
        with pytest.raises(InputError, match=f"'{text}'"):
            parse_peer(text, False)


def test_which_addresses_are_this_machines():
    for host in ("127.0.0.1", "127.8.9.1", "::1", "::ffff:127.0.0.1"):
        assert is_loopback(host)
    for host in ("128.0.0.1", "0.0.0.0", "::", "::ffff:10.0.0.1", "localhost", "", "fe80::1%eth0"):
        assert not is_loopback(host)


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_busy_port_is_reported_in_one_line(way, kind):
    port = way(f"{kind}://127.0.0.1:0").transport.address[1]
    with pytest.raises(InputError, match=r"address already in use.*; accepted: a free port") as e:
        way(f"{kind}://127.0.0.1:{port}")
    assert f"{kind}://127.0.0.1:{port}" in str(e.value) and "\n" not in str(e.value)


@pytest.mark.parametrize("kind", ["udpout", "tcpout"])
def test_a_host_that_cant_be_reached_is_reported(way, kind):
    """The broadcast address: UDP to it is forbidden, and TCP has no such thing."""
    with pytest.raises(InputError, match=r"can't (send there|connect) \(.*\); accepted: a host"):
        way(f"{kind}://255.255.255.255:9", allow_remote=True)


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


def test_a_datagram_longer_than_any_is_counted_not_cut(way, sockets):
    receiver = way("udpin://127.0.0.1:0")
    sender = sockets(socket.SOCK_DGRAM)
    sender.sendto(bytes(udp.MAX_DATAGRAM + 1), receiver.transport.address)
    sender.sendto(b"x" * udp.MAX_DATAGRAM, receiver.transport.address)
    assert receiver.read() == b"x" * udp.MAX_DATAGRAM
    assert receiver.counters["oversized"] == 1


def test_datagrams_of_another_machine_are_counted_not_read(way, sockets, monkeypatch):
    monkeypatch.setattr(udp, "is_loopback", lambda host: host != "127.0.0.2")
    receiver = way("udpin://127.0.0.1:0")
    foreign = sockets(socket.SOCK_DGRAM)
    foreign.bind(("127.0.0.2", 0))
    foreign.sendto(b"foreign", receiver.transport.address)
    sockets(socket.SOCK_DGRAM).sendto(b"own", receiver.transport.address)
    assert receiver.read() == b"own"
    assert receiver.counters["foreign_address"] == 1


def test_what_the_kernel_had_no_room_for_is_counted(way, sockets):
    receiver = way("udpin://127.0.0.1:0")
    sender = sockets(socket.SOCK_DGRAM)
    sent = 4000
    for _ in range(sent):
        sender.sendto(bytes(1000), receiver.transport.address)
    arrived = 0
    while receiver.transport.read() is not None:
        arrived += 1
    sender.sendto(b"the next one tells of it", receiver.transport.address)
    assert receiver.read().startswith(b"the next")
    assert receiver.counters["dropped"] == sent - arrived > 0


@pytest.mark.slow
def test_a_tcp_client_keeps_trying_and_comes_back(way):
    port = free_port()
    client = way(f"tcpout://127.0.0.1:{port}")
    assert not client.transport.connected
    client.read(0.05)
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
        assert 0 < client.transport.due_ns() <= 500_000_000
    assert client.transport.fileno() == descriptor


def test_what_it_is_to_be_connected_to_oneself(sockets):
    sock = sockets(bound=True)
    sock.connect(sock.getsockname())  # what a port without a server can come to
    assert tcp._is_itself(sock)
    server, client = sockets(bound=True), sockets()
    server.listen()
    client.connect(server.getsockname())
    assert not tcp._is_itself(client)
    assert tcp._is_itself(sockets())  # not connected at all


def test_a_tcp_client_never_talks_to_itself(way, monkeypatch):
    monkeypatch.setattr(tcp, "_is_itself", lambda sock: True)
    server = way("tcpin://127.0.0.1:0")
    client = way(f"tcpout://127.0.0.1:{server.transport.address[1]}")
    server.tend_until(lambda: server.transport.connected)
    client.read(0.05)
    assert not client.transport.connected


def test_a_tcp_server_answers_who_was_let_in_last(way, sockets):
    server = way("tcpin://127.0.0.1:0")
    assert server.transport.write(b"x", None) == "no_peer"
    first, second = sockets(server=server), sockets(server=server)
    for client in (first, second):
        client.sendall(b"?")
        assert server.read() == b"?"
    assert server.transport.write(b"1", None) == ""
    assert first.recv(9) == b"1"  # nobody let in yet: the first one that came
    server.transport.peer = second.getsockname()
    assert server.transport.write(b"2", None) == ""
    assert second.recv(9) == b"2"
    assert server.transport.write(b"3", first.getsockname()) == ""
    assert first.recv(9) == b"3"
    assert server.transport.write(b"4", ("127.0.0.1", 1)) == "no_peer"
    second.close()
    server.tend_until(lambda: server.transport.peer is None)
    assert server.transport.write(b"5", None) == ""
    assert first.recv(9) == b"5"


def test_silent_tcp_clients_make_room_for_others_and_partners_do_not(way, sockets):
    server = way("tcpin://127.0.0.1:0")

    def connect(word):
        client = sockets(server=server)
        client.sendall(word)
        assert server.read(0.2) in (word, b"")
        return client

    partner = connect(b"p")
    server.transport.peer = partner.getsockname()
    crowd = [connect(b"c") for _ in range(tcp.MAX_CLIENTS - 1)]
    late = connect(b"l")
    assert crowd[0].recv(9) == b""
    assert server.transport.write(b"!", partner.getsockname()) == ""
    assert partner.recv(9) == b"!"
    for client in (*crowd[1:], late):
        server.transport.peer = client.getsockname()
    refused = connect(b"r")
    with contextlib.suppress(ConnectionResetError):
        assert refused.recv(9) == b""
    assert server.counters["dropped"] == 1


def test_tcp_clients_of_another_machine_are_hung_up_on(way, sockets, monkeypatch):
    monkeypatch.setattr(tcp, "is_loopback", lambda host: False)
    server = way("tcpin://127.0.0.1:0")
    client = sockets(server=server)
    server.tend_until(lambda: server.counters["foreign_address"] == 1)
    assert client.recv(9) == b""


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
    while server.transport.write(b"x", None) != "send_failed":  # until the reset has come
        assert time.monotonic() < end
    results = [server.transport.write(b"x", None) for _ in range(3)]
    assert results == ["send_failed"] * 3
    server.tend_until(lambda: not server.transport.connected)


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
    assert 0 < serial.transport.due_ns() <= 1_000_000_000
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
    with pytest.raises(InputError, match=r"no such file.*; accepted: a serial device"):
        way("serial:///dev/ttyNone:57600")
    with pytest.raises(InputError, match=r"no baud rate 12345; accepted: 9600, .*57600, 115200"):
        way("serial:///dev/ttyNone:12345")
    file = tmp_path / "file"
    file.write_bytes(b"")
    with pytest.raises(InputError, match="can't open it"):
        way(f"serial://{file}:57600")


def test_a_retry_is_not_put_off_by_a_clock_that_is_set_back():
    now = [10**18]
    retry = RetryTimer(lambda: now[0], 500)
    assert retry.due_ns() == 0
    retry.now()
    now[0] += 200
    assert retry.due_ns() == 300
    now[0] -= 10**15
    assert retry.due_ns() == 0

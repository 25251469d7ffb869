"""The link: good frames come in from the right ones; nothing else gets in, steals or stops."""

import contextlib
import random
import socket
import time

import pytest
from mavlink_packets import encoder, heartbeat, hostile_packets
from pymavlink.dialects.v20 import common

from in_time import in_time
from tombo_dynamics.errors import InputError
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.udp import MAX_PARTNERS

KEY = bytes(range(1, 33))
OTHER_KEY = bytes(range(2, 34))
VEHICLE = {"system": 1, "component": 1}
COMPUTER = {"system": 245, "component": 191}


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


def collect(link, number=1, seconds=2.0, limit=200):
    """Receive until there are `number` messages, or the time is over."""
    arrived = []
    end = time.monotonic() + seconds
    while len(arrived) < number and time.monotonic() < end:
        link.wait(0.02)
        arrived += link.receive(limit)
    return arrived


def modes(received):
    return [item.message.custom_mode for item in received]


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


def test_the_local_port_of_a_sender_is_the_one_asked_for(links, sender):
    sender.bind(("127.0.0.1", 0))
    port = sender.getsockname()[1]
    sender.close()
    vehicle = links("udpin://127.0.0.1:0")
    computer = links(f"udpout://127.0.0.1:{vehicle.address[1]}?local={port}", COMPUTER)
    computer.send(beat(computer))
    (came,) = collect(vehicle)
    assert came.peer == computer.address == ("127.0.0.1", port)


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
        assert link.rejected_sender not in (None, *let_in)
    else:
        assert link.rejected_sender is None


def test_with_a_key_the_rest_is_refused_and_counted(links, sender):
    link = links("udpin://127.0.0.1:0", COMPUTER, key=KEY)
    vehicle = encoder(1, 1, KEY)
    vehicle.signing.timestamp = 2**47  # far in the future: newer than our start
    good = heartbeat(1, vehicle)
    sender.sendto(good, link.address)
    assert modes(collect(link)) == [1]
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
        assert modes(collect(link)) == [3]
    assert link.counters["replayed"] == 1
    assert link.counters["unsigned"] == 2
    assert link.counters["bad_signature"] == 1
    assert link._transport.peer == peer


def test_two_links_of_one_component_are_told_apart_by_their_link_id(links):
    receiver = links("udpin://127.0.0.1:0", COMPUTER, key=KEY)
    url = f"udpout://127.0.0.1:{receiver.address[1]}"
    ahead = links(url, key=KEY, link_id=1, clock=lambda: time.time_ns() + 3600 * 10**9)
    exact = links(url, key=KEY, link_id=2)
    for mode in range(3):
        ahead.send(beat(ahead, mode))
        exact.send(beat(exact, mode))
    assert len(collect(receiver, 6)) == 6


@pytest.mark.parametrize("url", ["udpin://127.0.0.1:0", "tcpin://127.0.0.1:0"])
@pytest.mark.parametrize(
    ("wrong", "message_part"),
    [
        ({"system": 0}, "system 0 is out of bounds; accepted: 1 to 255"),
        ({"component": 256}, "component 256 is out of bounds; accepted: 1 to 255"),
        ({"accept_system": -1}, "accept_system -1"),
        ({"link_id": 256}, "link_id 256"),
        ({"key": b"short"}, "key is no key; accepted: a file of 32 bytes"),
        ({"default_peer": "nowhere"}, "'nowhere'"),
    ],
)
def test_wrong_arguments_are_reported_in_one_line(url, wrong, message_part):
    with pytest.raises(InputError, match=message_part) as refusal:
        Link(url, **{**VEHICLE, "clock": time.time_ns, **wrong}).close()
    assert "\n" not in str(refusal.value) and "accepted" in str(refusal.value)


def test_values_that_do_not_fit_are_counted_not_raised(pair):
    vehicle, computer = pair()
    assert not computer.send(computer.mav.heartbeat_encode(6, 8, 0, 2**32, 3))
    assert not computer.send(computer.mav.heartbeat_encode(6, 8, None, 0, 3))
    assert "heartbeat" in computer.pack_error
    assert computer.counters["send_failed"] == 2 and computer.counters["sent"] == 0
    assert computer.send(beat(computer, 9))
    assert modes(collect(vehicle)) == [9]


def test_wait_sleeps_no_longer_than_it_must(pair):
    vehicle, computer = pair()
    begin = time.monotonic()
    assert not vehicle.wait(0.05)
    slept_s = time.monotonic() - begin
    assert slept_s > 0.045
    with in_time():
        assert slept_s < 1.0
    computer.send(beat(computer))
    begin = time.monotonic()
    assert vehicle.wait(5.0)
    with in_time():
        assert time.monotonic() - begin < 2.0


@pytest.mark.slow
def test_waiting_for_a_server_that_is_not_there_lets_the_next_try_be_made(links, sender):
    sender.bind(("127.0.0.1", 0))
    client = links(f"tcpout://127.0.0.1:{sender.getsockname()[1]}", COMPUTER)
    begin = time.monotonic()
    for _ in range(3):
        client.wait(5.0)
        client.receive()
    with in_time():
        assert time.monotonic() - begin < 4.0


def test_half_frames_over_tcp_are_put_together_for_each_client(links):
    link = links("tcpin://127.0.0.1:0", COMPUTER)
    with (
        socket.create_connection(link.address) as one,
        socket.create_connection(link.address) as two,
    ):
        a, b = heartbeat(1, encoder(1)), heartbeat(2, encoder(2))
        for first, second in zip(a, b, strict=True):
            one.sendall(bytes([first]))
            two.sendall(bytes([second]))
            link.wait(0.01)
            for item in link.receive():
                assert item.system == item.message.custom_mode
        collect(link, 2, 0.1)
        assert link.counters["received"] == 2
        assert link.counters["garbage_bytes"] == 0
        one.sendall(a[:11])
        collect(link, 1, 0.02)
    with socket.create_connection(link.address) as again:  # the half of before is forgotten
        again.sendall(heartbeat(3))
        assert modes(collect(link)) == [3]


def test_a_flood_from_elsewhere_costs_a_partner_no_message(links, sender):
    link = links("udpin://127.0.0.1:0", COMPUTER, accept_system=1)
    arrived = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        sender.sendto(heartbeat(0), link.address)
        arrived += collect(link)
        for mode in range(1, 20):
            for _ in range(3000):  # more than the kernel keeps, between two calls
                attacker.sendto(b"flood", link.address)
            sender.sendto(heartbeat(mode), link.address)
            arrived += link.receive(limit=10)
        arrived += collect(link, 20 - len(arrived))
        assert modes(arrived) == list(range(20))
        while link.wait(0.0):
            link.receive()
        attacker.sendto(b"flood", link.address)  # the next one tells of those lost before
        assert link.wait(1.0) and link.receive() == []
    assert link.counters["dropped"] > 0


def test_many_partners_are_all_heard_and_the_port_stays_busy_to_others(links):
    vehicle = links("udpin://127.0.0.1:0")
    url = f"udpout://127.0.0.1:{vehicle.address[1]}"
    clients = [links(url, COMPUTER) for _ in range(MAX_PARTNERS + 3)]
    for mode in range(5):
        for client in clients:
            client.send(beat(client, mode))
        arrived = collect(vehicle, len(clients))
        assert sorted(item.peer for item in arrived) == sorted(
            client.address for client in clients
        )
        for item in arrived:
            vehicle.send(beat(vehicle, mode), to=item.peer)
        for client in clients:
            assert modes(collect(client)) == [mode]
    assert len(vehicle._transport._partners) == MAX_PARTNERS
    with pytest.raises(InputError, match="in use"):
        links(f"udpin://127.0.0.1:{vehicle.address[1]}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="in use"):
            thief.bind(vehicle.address)


def besiege(link, feed, legitimate, packets):
    """Attack a link; return how many legitimate messages were sent, and how many came in order."""
    chance = random.Random(11)
    sent = arrived = 0
    for crowd in range(packets // 64):
        for packet in hostile_packets(chance, 64):
            feed(packet)
        legitimate(heartbeat(0x70000000 + crowd, encoder(9, 9)))
        sent += 1
        while link.wait(0.0):
            for item in link.receive():
                wanted = item.system == 9 and item.message.get_type() == "HEARTBEAT"
                arrived += wanted and item.message.custom_mode == 0x70000000 + arrived
    return sent, arrived


@pytest.mark.slow
def test_hostile_udp_senders_do_not_stop_the_link(links, sender):
    link = links("udpin://127.0.0.1:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        sent, arrived = besiege(
            link,
            lambda packet: attacker.sendto(packet, link.address),
            lambda packet: sender.sendto(packet, link.address),
            packets=40_000,
        )
    assert arrived == sent
    assert link.counters["bad_checksum"] > 0 and link.counters["garbage_bytes"] > 0
    assert link.counters["undecodable"] == 0


@pytest.mark.parametrize("pattern", [b"\xfd", b"\xfe", b"\xfe\xff\x00\x01\x01\x00", b"quiet"])
@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_one_call_does_a_bounded_piece_of_work(links, kind, pattern):
    link = links(f"{kind}in://127.0.0.1:0")
    steps = []
    look = link._frames

    def looking(packet):
        before = link._findings.tries
        frames = look(packet)
        steps[-1] += 1 + len(packet.data) // 256 + link._findings.tries - before
        return frames

    link._frames = looking
    kinds = {"udp": socket.SOCK_DGRAM, "tcp": socket.SOCK_STREAM}
    with socket.socket(socket.AF_INET, kinds[kind]) as attacker:
        attacker.connect(link.address)
        for _ in range(200):
            attacker.send((pattern * 1400)[:1400])
        while link.wait(0.05):
            steps.append(0)
            assert link.receive(limit=50) == []
    assert len(steps) > 1
    assert max(steps) < 4 * 50 + 16 + 512


def test_the_environment_cannot_switch_the_checksum_off(links, sender, monkeypatch):
    monkeypatch.setattr(common, "MAVLINK_IGNORE_CRC", "1")
    link = links("udpin://127.0.0.1:0", COMPUTER)
    bad = bytearray(heartbeat(1))
    bad[-1] ^= 1
    sender.sendto(bytes(bad), link.address)
    sender.sendto(heartbeat(2), link.address)
    assert modes(collect(link)) == [2]

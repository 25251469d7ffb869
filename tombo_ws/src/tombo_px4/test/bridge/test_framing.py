"""Frames: found among whatever comes, whole or in pieces; garbage costs and hides little."""

import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mavlink_packets import LONGEST, frame_with, heartbeat
from pymavlink.dialects.v20 import common

from tombo_px4.link import framing
from tombo_px4.link.framing import (
    DATAGRAM_TRIES,
    STREAM_TRIES,
    FrameCounts,
    StreamFramer,
    decode,
    frames_of,
)


def modes(frames):
    return [decode(frame).custom_mode for frame in frames]


def unknown(size=9, number=54321, signed=False):
    """A frame of a message that the dialect does not know, as PX4's own dialect has some."""
    flags = 1 if signed else 0
    head = struct.pack("<BBBBBBBHB", 0xFD, size, flags, 0, 0, 1, 1, number & 0xFFFF, number >> 16)
    return head + bytes(size + 2 + (13 if signed else 0))


@pytest.mark.parametrize("old", [False, True])
def test_every_message_of_the_dialect_is_found_and_decoded(old):
    numbers = [n for n in common.mavlink_map if n < 256 or not old]
    assert len(numbers) > 100
    for number in numbers:
        counts = FrameCounts()
        size = common.mavlink_map[number].unpacker.size
        data = frame_with(number, b"\x01" * size, 7, 8, old)
        (frame,) = frames_of(data, counts)
        assert (frame.data, frame.system, frame.component) == (data, 7, 8)
        assert frame.message_id == decode(frame).get_msgId() == number
        assert not frame.signed
        assert counts == FrameCounts()


def test_frames_in_one_datagram_with_garbage_between():
    counts = FrameCounts()
    data = b"noise" + heartbeat(1) + b"..." + heartbeat(2) + heartbeat(3) + b"end"
    assert modes(frames_of(data, counts)) == [1, 2, 3]
    assert counts == FrameCounts(garbage_bytes=11)


def test_a_flipped_bit_costs_its_own_frame_only():
    good = heartbeat(1)
    for position in range(len(good)):
        for bit in range(8):
            bad = bytearray(heartbeat(2))
            bad[position] ^= 1 << bit
            counts = FrameCounts()
            delivered = modes(frames_of(good + bytes(bad) + heartbeat(3), counts))
            assert delivered == [1, 3], (position, bit)
            assert counts.garbage_bytes + 12 * counts.unknown_message > 0


@pytest.mark.parametrize(
    "lie", [b"\xfd\xff\x00\x00\x00\x01\x01\x00\x00\x00", b"\xfe\xff\x00\x01\x01\x00"]
)
def test_a_header_with_a_false_length_swallows_nothing(lie):
    counts = FrameCounts()
    data = lie + b"".join(heartbeat(k) for k in range(1, 40))
    assert modes(frames_of(data, counts)) == list(range(1, 40))
    assert counts.bad_checksum == 1


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("size", [0, 9, 255])
def test_a_message_of_another_dialect_is_counted_and_passed_over(size, signed):
    counts = FrameCounts()
    other = unknown(size, signed=signed)
    data = heartbeat(1) + other + heartbeat(2) + other
    assert modes(frames_of(data, counts)) == [1, 2]
    assert counts == FrameCounts(unknown_message=2, tries=2)


def test_garbage_that_looks_like_a_message_hides_no_frame():
    counts = FrameCounts()
    lie = unknown(60)[:10]
    assert modes(frames_of(lie + heartbeat(1) + bytes(90), counts)) == [1]


@given(st.binary(max_size=700))
def test_no_bytes_raise_and_all_of_them_are_accounted_for(data):
    counts = FrameCounts()
    frames = frames_of(data, counts)
    assert sum(len(frame.data) for frame in frames) + counts.garbage_bytes <= len(data)
    assert counts.tries <= DATAGRAM_TRIES


@st.composite
def conversation(draw):
    """Good frames between pieces that are none and cannot look like the begin of a long one."""
    pieces, sent = [], []
    for k in range(draw(st.integers(1, 12))):
        kind = draw(st.sampled_from(["frame", "old", "cut", "flip", "noise", "unknown"]))
        if kind in ("frame", "old"):
            pieces.append(heartbeat(k + 1, old=kind == "old"))
            sent.append(k + 1)
        elif kind == "cut":
            pieces.append(heartbeat(99)[: draw(st.integers(1, 20))])
        elif kind == "flip":
            bad = bytearray(heartbeat(99))
            bad[draw(st.integers(10, len(bad) - 1))] ^= 1 << draw(st.integers(0, 7))
            pieces.append(bytes(bad))
        elif kind == "unknown":
            pieces.append(unknown(draw(st.integers(0, 255))))
        else:
            noise = draw(st.binary(max_size=40))
            pieces.append(noise.replace(b"\xfd", b"!").replace(b"\xfe", b"!"))
    return b"".join(pieces), sent


@pytest.mark.slow
@given(conversation(), st.lists(st.integers(1, 60), max_size=30))
@example((heartbeat(1) + heartbeat(99)[:3] + heartbeat(5), [1, 5]), [21, 21])
def test_a_stream_in_any_pieces_gives_the_frames_of_the_whole(talk, sizes):
    data, sent = talk
    data += bytes(LONGEST)  # so that a piece of a frame at the end is known to be none
    framer = StreamFramer(FrameCounts())
    delivered, at = [], 0
    for size in [*sizes, len(data)]:
        delivered += framer.feed(data[at : at + size])
        at += size
        assert len(framer._rest) <= LONGEST
    assert modes(delivered) == sent


@pytest.mark.parametrize(
    "pattern",
    [
        b"\xfd",
        b"\xfe",
        b"\xfd\xfe",
        b"\xfd\xff\x00\x00\x00\x01\x01\x00\x00\x00",
        b"\xfe\xff\x00\x01\x01\x00",
        b"\xfd\x00\x00",
        b"\xfd\x00\x01",
    ],
)
def test_the_worst_of_garbage_is_given_up_after_some_tries(pattern, monkeypatch):
    looked = []
    candidate = framing._candidate
    monkeypatch.setattr(framing, "_candidate", lambda *a: looked.append(1) or candidate(*a))
    data = (pattern * 4096)[:4096]
    counts = FrameCounts()
    assert frames_of(data[:2048], counts) == []
    assert len(looked) <= DATAGRAM_TRIES
    assert counts.garbage_bytes + 12 * counts.unknown_message == 2048
    looked.clear()
    framer = StreamFramer(FrameCounts())
    for _ in range(10):
        assert framer.feed(data) == []
        assert len(framer._rest) <= LONGEST
    assert len(looked) <= 10 * (STREAM_TRIES + 1)  # and the one that may go on

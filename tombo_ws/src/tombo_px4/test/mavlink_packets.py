"""Packets for tests of the link: good ones, and every kind of bad ones."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator

from pymavlink.dialects.v20 import common

LONGEST = 255 + 12 + 13
"""Bytes of the longest frame."""

NUMBERS = sorted(common.mavlink_map)
_WILD = (
    b"\xff\xff\xff\xff",
    b"\x00\x00\xc0\x7f",  # NaN
    b"\x00\x00\x80\x7f",  # infinity
    b"\x00\x00\x80\xff",
    b"\xff\xff\x7f\x7f",  # largest
    b"\x01\x00\x00\x00",  # smallest
    b"\x00\x00\x00\x80",
    b"\x00\x00\x00\x00",
)


def encoder(system: int = 1, component: int = 1, key: bytes | None = None) -> common.MAVLink:
    """Return an encoder of some ids, signing if there is a key."""
    mav = common.MAVLink(None, system, component)
    if key:
        mav.signing.secret_key = key
        mav.signing.sign_outgoing = True
    return mav


def heartbeat(mode: int = 0, mav: common.MAVLink | None = None, old: bool = False) -> bytes:
    """Return a heartbeat whose custom mode tells it from others."""
    mav = mav or encoder()
    packed: bytes = mav.heartbeat_encode(6, 8, 0, mode, 3).pack(mav, force_mavlink1=old)
    return packed


def frame_with(
    number: int, payload: bytes, system: int = 1, component: int = 1, old: bool = False
) -> bytes:
    """Return a frame of a known message with any payload at all and a valid checksum."""
    if old:
        head = struct.pack("<BBBBBB", 0xFE, len(payload), 0, system, component, number)
    else:
        head = struct.pack(
            "<BBBBBBBHB",
            *(0xFD, len(payload), 0, 0, 0, system, component, number & 0xFFFF, number >> 16),
        )
    kind = common.mavlink_map.get(number)
    crc = common.x25crc((head + payload)[1:] + bytes([kind.crc_extra if kind else 0])).crc
    return head + payload + struct.pack("<H", crc)


def wild_payload(chance: random.Random, size: int) -> bytes:
    """Return a payload of bytes at random, or of NaN, infinities and extremes."""
    if chance.random() < 0.5:
        return chance.randbytes(size)
    return b"".join(chance.choice(_WILD) for _ in range(size // 4 + 1))[:size]


def wild_frame(chance: random.Random, system: int = 1, component: int = 1) -> bytes:
    """Return a valid frame of any message whose content means nothing."""
    number = chance.choice(NUMBERS)
    size = common.mavlink_map[number].unpacker.size
    if chance.random() < 0.3:
        size = chance.randrange(256)
    old = number < 256 and chance.random() < 0.2
    return frame_with(number, wild_payload(chance, min(size, 255)), system, component, old)


def hostile_packets(chance: random.Random, number: int) -> Iterator[bytes]:
    """Yield packets of every bad kind in turn: noise, cut, flipped, false, wild, crowded."""
    for k in range(number):
        kind = k % 8
        frame = wild_frame(chance)
        if kind == 0:
            yield chance.randbytes(chance.randrange(300))
        elif kind == 1:
            yield frame[: chance.randrange(len(frame))]
        elif kind == 2:
            bad = bytearray(frame)
            for _ in range(chance.randrange(1, 4)):
                bad[chance.randrange(len(bad))] ^= 1 << chance.randrange(8)
            yield bytes(bad)
        elif kind == 3:  # a header that promises anything
            yield bytes([chance.choice((0xFD, 0xFE))]) + chance.randbytes(chance.randrange(40))
        elif kind == 4:
            yield frame
        elif kind == 5:
            yield wild_frame(chance, chance.randrange(256), chance.randrange(256))
        elif kind == 6:
            yield chance.choice((b"\xfd", b"\xfe", b"\xfd\x00", b"\xfe\xff\x00\x01\x01\x00")) * 300
        else:
            yield frame + chance.randbytes(20) + wild_frame(chance) + frame[:5]

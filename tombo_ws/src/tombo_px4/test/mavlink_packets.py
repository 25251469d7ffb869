"""Packets for tests of the link."""

from __future__ import annotations

from pymavlink.dialects.v20 import common


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

"""Identity of the simulated vehicle: a PX4 1.17 quadrotor."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link.added_messages import ProtocolVersion

_VERSION = 1 << 24 | 17 << 16 | 0 << 8 | 255
"""1.17.0; 255: a release, `FIRMWARE_VERSION_TYPE_OFFICIAL`."""
CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
"""No missions, no file transfer: what is not simulated is not claimed."""
_CUSTOM = list(b"tombosim")
_UID = 0x544F4D424F
"""Any number but 0, which clients take for "has none"."""


def autopilot_version(mav: Any) -> Any:
    """Return AUTOPILOT_VERSION."""
    uid = list(_UID.to_bytes(18, "big"))
    return mav.autopilot_version_encode(
        CAPABILITIES, _VERSION, _VERSION, 0, 0, _CUSTOM, _CUSTOM, 8 * [0], 0, 0, _UID, uid
    )


def protocol_version() -> Any:
    """Return PROTOCOL_VERSION: MAVLink 2.0, nothing older is spoken."""
    return ProtocolVersion(200, 200, 200, 8 * [0], 8 * [0])

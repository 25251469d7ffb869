"""Answers that need no state: to PING, missions, logs, files; of the last three there are none."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link.file_transfer import HEADER, PAYLOAD, FileError, Operation

_FTP_KNOWN = range(16)


MISSION_MESSAGES = (
    "MISSION_REQUEST_LIST",
    "MISSION_COUNT",
    "MISSION_CLEAR_ALL",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_WRITE_PARTIAL_LIST",
)
"""Those that `mission_answer` knows; items of an upload that was refused are not answered."""


def mission_answer(mav: Any, message: Any, system: int, component: int) -> Any:
    """Return the answer to a mission, fence or rally message: there are none, none are taken."""
    name = message.get_type()
    kind = getattr(message, "mission_type", 0)
    if name == "MISSION_REQUEST_LIST":
        return mav.mission_count_encode(system, component, 0, kind)
    if name == "MISSION_CLEAR_ALL" or (name == "MISSION_COUNT" and message.count == 0):
        result = mavlink.MAV_MISSION_ACCEPTED
    elif name in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
        result = mavlink.MAV_MISSION_INVALID_SEQUENCE
    else:
        result = mavlink.MAV_MISSION_ERROR
    return mav.mission_ack_encode(system, component, result, kind)


def ping_answer(mav: Any, message: Any, system: int, component: int) -> Any | None:
    """Return the answer to PING; None: it is an answer itself, or for another."""
    if (message.target_system, message.target_component) != (0, 0):
        return None
    return mav.ping_encode(message.time_usec, message.seq, system, component)


def no_logs(mav: Any, message: Any, system: int, component: int) -> Any:
    """Return the answer to LOG_REQUEST_LIST: there are none."""
    return mav.log_entry_encode(0, 0, 0, 0, 0)


def file_answer(mav: Any, message: Any, system: int, component: int) -> Any | None:
    """Return the answer to FILE_TRANSFER_PROTOCOL: no such file; None: not a request."""
    asked = bytes(message.payload)
    sequence, session, operation, _, _, _, _, offset = HEADER.unpack_from(asked)
    if operation >= Operation.ACK:
        return None
    if operation in (Operation.TERMINATE, Operation.RESET):
        answer, data = Operation.ACK, b""
    else:
        error = FileError.NOT_FOUND if operation in _FTP_KNOWN else FileError.UNKNOWN_COMMAND
        answer, data = Operation.NAK, bytes([error])
    sequence = (sequence + 1) % 65536
    head = HEADER.pack(sequence, session, answer, len(data), operation, 0, 0, offset)
    payload = (head + data).ljust(PAYLOAD, b"\x00")
    return mav.file_transfer_protocol_encode(0, system, component, list(payload))

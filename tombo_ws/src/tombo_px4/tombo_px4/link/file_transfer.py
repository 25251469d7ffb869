"""Reads a file of the vehicle by MAVLink FTP: one request under way, repeated, then given up."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.message_encoder import MessageTarget

HEADER = struct.Struct("<HBBBBBBI")
"""Sequence, session, operation, size, operation asked for, burst complete, padding, offset."""
PAYLOAD, DATA = 251, 239
"""Bytes of a message, and of its data."""
LARGEST_FILE = 1 << 20
"""Bytes of a file that is read; the files of PX4 1.17 have 16 kB."""
_AGAIN_NS = SECOND_NS // 2
_TRIES = 6


@dataclass(frozen=True)
class FileAnswer:
    """An answer of the vehicle."""

    sequence: int
    session: int
    operation: int
    """ACK or NAK."""
    asked: int
    """The operation that is answered."""
    offset: int
    data: bytes


def file_answer(payload: bytes) -> FileAnswer | None:
    """Return the answer in a payload of FILE_TRANSFER_PROTOCOL; None: it is none."""
    if len(payload) < HEADER.size:
        return None
    sequence, session, operation, size, asked, _, _, offset = HEADER.unpack_from(payload)
    if operation not in (mav.MAV_FTP_OPCODE_ACK, mav.MAV_FTP_OPCODE_NAK) or size > DATA:
        return None
    data = payload[HEADER.size : HEADER.size + size]
    return FileAnswer(sequence, session, operation, asked, offset, data)


class FileReader:
    """Reads one file.

    Attributes:
        content: of the file; None as long as it is not read.
        failed: why it can't be read; empty as long as it may.
    """

    def __init__(self, path: str, to: MessageTarget) -> None:
        self.content: bytes | None = None
        self.failed = ""
        self._path, self._to = path, to
        self._operation = mav.MAV_FTP_OPCODE_OPENFILERO
        self._session = 0
        self._size = 0
        self._read = bytearray()
        self._sequence = 0
        self._sent_ns: int | None = None
        self._tries = 0

    @property
    def over(self) -> bool:
        """Nothing more is read."""
        return self.content is not None or bool(self.failed)

    def take(self, answer: FileAnswer) -> None:
        """Take an answer; one to another request changes nothing."""
        if self.over or (answer.sequence, answer.asked) != (
            (self._sequence + 1) % 65536,
            self._operation,
        ):
            return
        self._sequence = (self._sequence + 2) % 65536
        self._sent_ns, self._tries = None, 0
        refused = answer.operation == mav.MAV_FTP_OPCODE_NAK
        error = answer.data[0] if answer.data else 0
        if refused and (
            self._operation == mav.MAV_FTP_OPCODE_OPENFILERO or error != mav.MAV_FTP_ERR_EOF
        ):
            self.failed = f"{self._path}: the vehicle refuses it (error {error})"
        elif self._operation == mav.MAV_FTP_OPCODE_OPENFILERO:
            self._opened(answer)
        elif refused or not answer.data:
            self.content = bytes(self._read)
        elif answer.offset == len(self._read):
            self._read += answer.data
            if len(self._read) >= self._size:
                self.content = bytes(self._read[: self._size])

    def _opened(self, answer: FileAnswer) -> None:
        size = int.from_bytes(answer.data[:4], "little")
        if not 0 < size <= LARGEST_FILE:
            self.failed = f"{self._path}: {size} bytes; accepted: 1 to {LARGEST_FILE}"
        self._session, self._size = answer.session, size
        self._operation = mav.MAV_FTP_OPCODE_READFILE

    def tick(self, now_ns: int) -> list[Any]:
        """Return what to send now."""
        if self.over or (self._sent_ns is not None and 0 <= now_ns - self._sent_ns < _AGAIN_NS):
            return []
        if self._tries >= _TRIES:
            self.failed = f"{self._path}: the vehicle does not answer"
            return []
        self._tries += 1
        self._sent_ns = now_ns
        if self._operation == mav.MAV_FTP_OPCODE_OPENFILERO:
            return [self._message(mav.MAV_FTP_OPCODE_OPENFILERO, self._path.encode()[:DATA])]
        rest = min(self._size - len(self._read), DATA)
        return [self._message(mav.MAV_FTP_OPCODE_READFILE, b"", size=rest, offset=len(self._read))]

    def close(self) -> list[Any]:
        """Return the message that frees the vehicle's session; none where there is none."""
        if self._operation == mav.MAV_FTP_OPCODE_OPENFILERO:
            return []
        return [self._message(mav.MAV_FTP_OPCODE_TERMINATESESSION, b"")]

    def _message(
        self, operation: int, data: bytes, *, size: int | None = None, offset: int = 0
    ) -> Any:
        size = len(data) if size is None else size
        head = HEADER.pack(self._sequence, self._session, operation, size, 0, 0, 0, offset)
        payload = list((head + data).ljust(PAYLOAD, b"\x00"))
        return mav.MAVLink_file_transfer_protocol_message(0, *self._to, payload)

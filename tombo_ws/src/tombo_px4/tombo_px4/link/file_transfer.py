"""Reads a file of the vehicle by MAVLink FTP: one request under way, repeated, then given up."""

from __future__ import annotations

import struct
from typing import Any

from pymavlink.dialects.v20 import common as mav
from pymavlink.mavftp_op import FTP_OP, OP_Ack, OP_Nack, OP_OpenFileRO, OP_ReadFile

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.message_encoder import MessageTarget

FileAnswer = FTP_OP
"""An answer of the vehicle."""
_HEADER = struct.Struct("<HBBBBBxI")
_PAYLOAD, _DATA = 251, 239
"""Bytes of a message, and of its data."""
_LARGEST_FILE = 1 << 20
"""Bytes of a file that is read; the files of PX4 1.17 have 16 kB."""
_AGAIN_NS = SECOND_NS // 2
_TRIES = 6


def file_answer(payload: bytes) -> FTP_OP | None:
    """Return the answer in a payload of FILE_TRANSFER_PROTOCOL; None: it is none."""
    if len(payload) < _HEADER.size:
        return None
    fields = _HEADER.unpack_from(payload)
    answer = FTP_OP(*fields, payload[_HEADER.size : _HEADER.size + fields[3]])
    return answer if answer.opcode in (OP_Ack, OP_Nack) else None


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
        self._session = self._sequence = self._tries = 0
        self._size: int | None = None
        self._read = b""
        self._sent_ns: int | None = None

    @property
    def over(self) -> bool:
        """Nothing more is read."""
        return self.content is not None or bool(self.failed)

    def take(self, answer: FTP_OP) -> None:
        """Take an answer; one to another request changes nothing."""
        asked = OP_OpenFileRO if self._size is None else OP_ReadFile
        if self.over or (answer.seq, answer.req_opcode) != ((self._sequence + 1) % 65536, asked):
            return
        self._sequence = (self._sequence + 2) % 65536
        self._sent_ns, self._tries = None, 0
        data = bytes(answer.payload)
        if answer.opcode == OP_Nack or not data:
            self.failed = f"{self._path}: the vehicle refuses it (error {data[:1].hex() or '-'})"
        elif self._size is None:
            self._session, self._size = answer.session, int.from_bytes(data[:4], "little")
            if not 0 < self._size <= _LARGEST_FILE:
                self.failed = f"{self._path}: {self._size} bytes; accepted: 1 to {_LARGEST_FILE}"
        elif answer.offset == len(self._read):
            self._read += data
            if len(self._read) >= self._size:
                self.content = self._read[: self._size]

    def tick(self, now_ns: int) -> list[Any]:
        """Return what to send now."""
        if self.over or (self._sent_ns is not None and 0 <= now_ns - self._sent_ns < _AGAIN_NS):
            return []
        if self._tries >= _TRIES:
            self.failed = f"{self._path}: the vehicle does not answer"
            return []
        self._tries += 1
        self._sent_ns = now_ns
        if self._size is None:
            path = self._path.encode()[:_DATA]
            return [self._message(OP_OpenFileRO, len(path), 0, path)]
        at = len(self._read)
        return [self._message(OP_ReadFile, min(self._size - at, _DATA), at)]

    def close(self) -> list[Any]:
        """Return the message that frees the vehicle's session; none where there is none."""
        if self._size is None:
            return []
        return [self._message(mav.MAV_FTP_OPCODE_TERMINATESESSION, 0, 0)]

    def _message(self, operation: int, size: int, offset: int, data: bytes = b"") -> Any:
        request = FTP_OP(self._sequence, self._session, operation, size, 0, 0, offset, data)
        payload = list(request.pack().ljust(_PAYLOAD, b"\0"))
        return mav.MAVLink_file_transfer_protocol_message(0, *self._to, payload)

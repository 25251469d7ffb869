"""Walks through an MCAP file record by record and notes its contents and its damage.

The `mcap` library's readers stop with an error where a file was cut off. This walk takes all whole
records, and lists the damage.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from numpy.typing import NDArray

from tombo_bag.formats.chunks import HEAD, MAGIC, PREFIX_SIZE
from tombo_bag.formats.unpacking import unpack

_RECORD = struct.Struct("<BQ")
"""Head of a record, as the MCAP format has it: opcode, length of the body."""
_CHUNK = struct.Struct("<QQQII")
"""Start and end [ns], size unpacked, checksum, length of the compression's name."""
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time [ns]."""
_FIRST_PRIVATE = 0x80
"""First opcode that is free for private use."""
_DAMAGE = (struct.error, ValueError, IndexError, EndOfFile)
"""Errors of reading a damaged record."""


@dataclass
class ChunkPlace:
    """One chunk of a file. `index`: channel → (n, 2) log time and offset; None: look inside.

    Messages outside of chunks are gathered as if the file were one, with offset 0.
    """

    offset: int
    start_ns: int
    end_ns: int
    size: int
    checksum: int
    compression: str
    data: memoryview
    whole: bool = True
    index: dict[int, NDArray[np.uint64]] | None = None

    def __str__(self) -> str:
        """Name the chunk by its place and log time."""
        return f"chunk at byte {self.offset} (log time {self.start_ns} to {self.end_ns} ns)"


@dataclass
class FileMap:
    """Contents of a file."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    """Unreadable parts, a line each."""
    data_ended: bool = False
    finished: bool = False


def walk(file: memoryview) -> FileMap:
    """Walk through a whole file that begins with the MCAP magic, or with a part of it."""
    file_map, end = FileMap(), len(MAGIC)
    loose: dict[int, list[tuple[int, int]]] = {}
    indexed: dict[int, NDArray[np.uint64]] = {}
    try:
        for opcode, at, body in _records(file, len(MAGIC)):
            if opcode == 0 or Opcode.DATA_END < opcode < _FIRST_PRIVATE:
                break
            if opcode == Opcode.CHUNK:
                indexed = {}
                _chunk(file_map, at, body, whole=True)
            elif opcode == Opcode.MESSAGE_INDEX:
                channel, size = struct.unpack_from("<HI", body)
                indexed[channel] = np.frombuffer(body, "<u8", size // 8, 6).reshape(-1, 2)
                file_map.chunks[-1].index = indexed
            elif opcode == Opcode.MESSAGE:
                channel, _, log_time, _ = _MESSAGE.unpack_from(body)
                loose.setdefault(channel, []).append((log_time, at))
            else:
                note(file_map, opcode, body)
            end = at + PREFIX_SIZE + len(body)
            file_map.data_ended |= opcode == Opcode.DATA_END
            if opcode == Opcode.FOOTER:
                file_map.finished = True
                break
    except _DAMAGE:
        pass  # the records before it count
    if end + PREFIX_SIZE <= len(file) and file[end] == Opcode.CHUNK:
        _chunk(file_map, end, file[end + PREFIX_SIZE :], whole=False)
    if loose:
        index = {channel: np.array(places, np.uint64) for channel, places in loose.items()}
        times = np.concatenate([of[:, 0] for of in index.values()])
        file_map.chunks.append(
            ChunkPlace(0, int(times.min()), int(times.max()), len(file), 0, "", file, index=index)
        )
    if not file_map.finished or file[end:] != MAGIC:
        file_map.damage.append(_stopped(file_map, file, end))
    return file_map


def _records(data: memoryview, at: int) -> Iterator[tuple[int, int, memoryview]]:
    """Yield opcode, offset in `data` and body of each whole record from offset `at` on."""
    while at + PREFIX_SIZE <= len(data):
        opcode, length = _RECORD.unpack_from(data, at)
        body = at + PREFIX_SIZE
        if body + length > len(data):
            return
        yield opcode, at, data[body : body + length]
        at = body + length


def note(file_map: FileMap, opcode: int, body: memoryview) -> None:
    """Note a schema, channel or metadata record; others need no noting."""
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        file_map.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        file_map.channels[channel.id] = channel
    elif opcode == Opcode.METADATA:
        file_map.metadata.append(Metadata.read(stream))


def _chunk(file_map: FileMap, at: int, body: memoryview, *, whole: bool) -> None:
    """Note the chunk at offset `at` of the file, as far as it is there."""
    if len(body) < _CHUNK.size:
        return
    start, end, size, checksum, name_size = _CHUNK.unpack_from(body)
    data = _CHUNK.size + name_size + 8
    compression = bytes(body[_CHUNK.size : data - 8]).decode("ascii", "replace")
    if len(body) >= data:
        place = ChunkPlace(at, start, end, size, checksum, compression, body[data:], whole)
        file_map.chunks.append(place)


def _stopped(file_map: FileMap, file: memoryview, at: int) -> str:
    """Describe why the walk did not end with footer and magic."""
    last = file_map.chunks[-1] if file_map.chunks else None
    if file_map.data_ended:
        return f"all messages are there, but the summary is damaged from byte {at}"
    if last is not None and not last.whole:
        return f"file cut off at byte {len(file)}, inside {last}"
    if at >= len(file):
        return f"file ends at byte {at} without its summary: the writer was not closed"
    return f"file cut off at byte {at}: the {len(file) - at} bytes from there are no whole record"


def open_chunk(place: ChunkPlace) -> bytes | memoryview:
    """Decompress a chunk, as far as it is there, and check it.

    Raises:
        ValueError: it can't be read, and why.
    """
    try:
        data: bytes | memoryview = unpack(place.compression, place.data, place.size)
        if place.whole and len(data) != place.size:
            raise ValueError(f"{len(data)} bytes instead of {place.size}")
        if place.whole and place.checksum and zlib.crc32(data) != place.checksum:
            raise ValueError("its checksum is wrong")
    except ValueError as error:
        raise ValueError(f"{place} is corrupt: {error}") from error
    return data


def index_chunk(data: bytes | memoryview, file_map: FileMap) -> dict[int, NDArray[np.uint64]]:
    """List a chunk's messages and note its schemas and channels."""
    view = memoryview(data)
    places: dict[int, list[tuple[int, int]]] = {}
    try:
        for opcode, at, body in _records(view, 0):
            if opcode == 0:
                break  # no record: zeros
            if opcode == Opcode.MESSAGE:
                channel, _, log_time, _ = _MESSAGE.unpack_from(body)
                places.setdefault(channel, []).append((log_time, at))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                note(file_map, opcode, body)
    except _DAMAGE:
        pass  # the records before it count
    return {channel: np.array(rows, np.uint64) for channel, rows in places.items()}


def extract_messages(
    data: bytes | memoryview, channel: int, offsets: NDArray[np.uint64]
) -> tuple[NDArray[np.void], list[bytes]] | None:
    """Take messages out of a chunk: their heads and their bytes; None if the index is damaged."""
    starts = offsets.astype(np.int64)
    if starts.size and not 0 <= starts.min() <= starts.max() <= len(data) - HEAD.itemsize:
        return None
    block = np.frombuffer(data, np.uint8)[starts[:, None] + np.arange(HEAD.itemsize)]
    heads: NDArray[np.void] = block.view(HEAD).ravel()
    ends = starts + PREFIX_SIZE + heads["length"].astype(np.int64)
    right = (heads["opcode"] == Opcode.MESSAGE) & (heads["channel"] == channel)
    if not (right & (ends <= len(data)) & (ends >= starts + HEAD.itemsize)).all():
        return None
    pairs = zip((starts + HEAD.itemsize).tolist(), ends.tolist(), strict=True)
    return heads, [bytes(data[start:end]) for start, end in pairs]

"""Walks through an MCAP file record by record and notes what is there and what is damaged.

The `mcap` library's readers stop with an error where a file was cut off. This walk takes all that
is whole and says, as data, what is not.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from io import BytesIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from numpy.typing import NDArray

from tombo_bag.formats.chunks import HEAD, MAGIC, PREFIX_SIZE
from tombo_bag.formats.unpacking import UNPACK

_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQI")
_MESSAGE = struct.Struct("<HIQQ")
FIRST_PRIVATE_OPCODE = 0x80


@dataclass(frozen=True)
class Damage:
    """Something in a file that can't be read.

    Attributes:
        kind: `cut off` (the file ends too early), `not finished` (whole, but never closed) or
            `corrupt` (bytes are not what was written).
        offset: first byte of the file that is affected.
        size: number of bytes from there that give no, or no checked, messages.
        from_ns: log time from which messages may be missing; None if not known.
        to_ns: log time up to which messages may be missing; None if not known.
        text: the same in one line, for a person.
    """

    kind: str
    offset: int
    size: int
    from_ns: int | None
    to_ns: int | None
    text: str

    def __str__(self) -> str:
        """Return the line for a person."""
        return self.text


@dataclass
class ChunkPlace:
    """One chunk of a file. `index`: channel → (n, 2) log time and offset; None: look inside.

    Messages that stand in no chunk are gathered as if the file were one, with offset 0.
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
    """What the walk found in a file."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    data_ended: bool = False
    finished: bool = False


def walk(file: memoryview) -> FileMap:
    """Walk through a whole file that begins with the MCAP magic, or with a part of it."""
    file_map = FileMap()
    loose: dict[int, list[tuple[int, int]]] = {}
    indexed: dict[int, NDArray[np.uint64]] = {}
    at = len(MAGIC)
    while not file_map.finished:
        if at + PREFIX_SIZE > len(file):
            break
        opcode, length = _RECORD.unpack_from(file, at)
        body = at + PREFIX_SIZE
        if opcode == 0 or Opcode.DATA_END < opcode < FIRST_PRIVATE_OPCODE:
            break
        if opcode != Opcode.MESSAGE_INDEX:
            if indexed and file_map.chunks and file_map.chunks[-1].index is None:
                file_map.chunks[-1].index = indexed
            indexed = {}
        if body + length > len(file):
            if opcode == Opcode.CHUNK:
                _chunk(file_map, file, at, len(file) - body, length)
            break
        try:
            if opcode == Opcode.CHUNK:
                _chunk(file_map, file, at, length, length)
            elif opcode == Opcode.MESSAGE_INDEX:
                channel, size = struct.unpack_from("<HI", file, body)
                rows = np.frombuffer(file, "<u8", size // 8, body + 6).reshape(-1, 2)
                indexed[channel] = rows
            elif opcode == Opcode.MESSAGE:
                channel, _, log_time, _ = _MESSAGE.unpack_from(file, body)
                loose.setdefault(channel, []).append((log_time, at))
            else:
                note(file_map, opcode, file[body : body + length])
        except (struct.error, ValueError, EndOfFile):
            break
        file_map.data_ended |= opcode == Opcode.DATA_END
        file_map.finished = opcode == Opcode.FOOTER
        at = body + length
    if loose:
        index = {channel: np.array(places, np.uint64) for channel, places in loose.items()}
        times = np.concatenate([of[:, 0] for of in index.values()])
        file_map.chunks.append(
            ChunkPlace(0, int(times.min()), int(times.max()), len(file), 0, "", file, index=index)
        )
    if not file_map.finished or file[at:] != MAGIC:
        file_map.damage.append(_stopped(file_map, file, at))
    return file_map


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


def _chunk(file_map: FileMap, file: memoryview, at: int, there: int, length: int) -> None:
    body = file[at + PREFIX_SIZE : at + PREFIX_SIZE + there]
    if len(body) < _CHUNK.size + 4:
        return
    start, end, size, checksum = _CHUNK.unpack_from(body)
    (name_size,) = struct.unpack_from("<I", body, _CHUNK.size)
    data = _CHUNK.size + 4 + name_size + 8
    compression = bytes(body[_CHUNK.size + 4 : data - 8]).decode("ascii", "replace")
    if len(body) < data:
        return
    file_map.chunks.append(
        ChunkPlace(at, start, end, size, checksum, compression, body[data:], there == length)
    )


def _stopped(file_map: FileMap, file: memoryview, at: int) -> Damage:
    """Describe why the walk did not end with footer and magic."""
    lost = max(len(file) - at, 0)
    if file_map.data_ended:
        text = f"all messages are there, but the summary is damaged from byte {at}"
        return Damage("cut off", at, lost, None, None, text)
    last = file_map.chunks[-1] if file_map.chunks else None
    if last is not None and not last.whole:
        text = f"file cut off at byte {len(file)}, inside {last}"
        return Damage("cut off", at, lost, last.start_ns, last.end_ns, text)
    since = None if last is None else last.end_ns
    if lost == 0:
        text = f"file ends at byte {at} without its summary: the writer was not closed"
        return Damage("not finished", at, 0, since, None, text)
    opcode, length = _RECORD.unpack_from(file, at) if lost >= PREFIX_SIZE else (None, 0)
    if opcode is None or (0 < opcode <= Opcode.DATA_END and at + PREFIX_SIZE + length > len(file)):
        text = f"file cut off at byte {len(file)}, inside the record that starts at byte {at}"
        return Damage("cut off", at, lost, since, None, text)
    text = f"no MCAP record at byte {at}: the {lost} bytes from there can't be read"
    return Damage("corrupt", at, lost, since, None, text)


def open_chunk(place: ChunkPlace, largest: int) -> tuple[bytes | memoryview, Damage | None]:
    """Decompress a chunk of at most `largest` bytes, as far as it is there, and check it."""
    size = PREFIX_SIZE + len(place.data)

    def corrupt(why: str) -> Damage:
        text = f"{place} is corrupt: {why}"
        return Damage("corrupt", place.offset, size, place.start_ns, place.end_ns, text)

    unpack = _DECOMPRESS.get(place.compression)
    if unpack is None:
        return b"", corrupt(f"compression '{place.compression}' is none of zstd, lz4 or none")
    if place.compression and place.size > largest:
        return b"", corrupt(f"it states {place.size} bytes, more than {largest}")
    try:
        data = unpack(place.data, place.size)
    except (ValueError, MemoryError) as error:
        return b"", corrupt((str(error) or "not enough memory").splitlines()[0])
    if not place.whole:
        return data, None
    if len(data) != place.size:
        return b"", corrupt(f"{len(data)} bytes instead of {place.size}")
    if place.checksum and zlib.crc32(data) != place.checksum:
        return b"", corrupt("its checksum is wrong")
    return data, None


def refine_truncation(file_map: FileMap, place: ChunkPlace) -> None:
    """Say in the damage of a chunk that was cut off how far its messages could be read."""
    times = [int(rows[:, 0].max()) for rows in (place.index or {}).values()]
    if not times:
        return
    for i, damage in enumerate(file_map.damage):
        if damage.offset == place.offset and damage.kind == "cut off":
            text = f"{damage.text}; its messages up to {max(times)} ns are read, unchecked"
            file_map.damage[i] = replace(damage, from_ns=max(times), text=text)


def index_chunk(data: bytes | memoryview, file_map: FileMap) -> dict[int, NDArray[np.uint64]]:
    """List a chunk's messages and note its schemas and channels."""
    view = memoryview(data)
    places: dict[int, list[tuple[int, int]]] = {}
    at = 0
    while at + PREFIX_SIZE <= len(view):
        opcode, length = _RECORD.unpack_from(view, at)
        body = at + PREFIX_SIZE
        if body + length > len(view):
            break
        if opcode == 0:
            break  # no record: zeros
        if opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
            channel, _, log_time, _ = _MESSAGE.unpack_from(view, body)
            places.setdefault(channel, []).append((log_time, at))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            try:
                note(file_map, opcode, view[body : body + length])
            except (struct.error, ValueError, EndOfFile):
                break
        at = body + length
    return {channel: np.array(rows, np.uint64) for channel, rows in places.items()}


def extract_messages(
    data: bytes | memoryview, channel: int, offsets: NDArray[np.uint64]
) -> tuple[NDArray[np.void], list[bytes]] | None:
    """Take messages out of a chunk: their heads and their bytes; None if the index is wrong."""
    starts = offsets.astype(np.int64)
    if len(starts) and (starts.min() < 0 or starts.max() + HEAD.itemsize > len(data)):
        return None
    bytes_of = np.frombuffer(data, np.uint8)
    heads = bytes_of[starts[:, None] + np.arange(HEAD.itemsize)].view(HEAD).ravel()
    if not ((heads["opcode"] == Opcode.MESSAGE) & (heads["channel"] == channel)).all():
        return None
    lengths = heads["length"]
    if (lengths < _MESSAGE.size).any() or (lengths > len(data)).any():
        return None
    ends = starts + PREFIX_SIZE + lengths.astype(np.int64)
    if len(ends) and (ends.max() > len(data) or int(lengths.sum()) > len(data)):
        return None  # beyond the chunk, or one message many times
    pairs = zip((starts + HEAD.itemsize).tolist(), ends.tolist(), strict=True)
    if isinstance(data, bytes):
        return heads, [data[start:end] for start, end in pairs]
    return heads, [bytes(data[start:end]) for start, end in pairs]


_DECOMPRESS: dict[str, Callable[[memoryview, int], bytes | memoryview]] = {
    "": lambda data, size: data,
    "zstd": UNPACK["zstd"],
    "lz4": UNPACK["lz4"],
}

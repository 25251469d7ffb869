"""Writes an MCAP file of ROS 2 messages: single messages as they come, or whole columns.

One file format, one code path: the headless flight hands over columns, a recorder hands over the
bytes of each message. Chunks hold at most one second of log time and go to the system as soon as
they are full, so a process that is killed leaves all older messages readable. Headers, indexes and
summary are the `mcap` library's own records.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from tombo_bag.formats.chunks import (
    MAGIC,
    Source,
    assemble,
    slices,
    source_of,
    write_message_index,
)
from tombo_bag.qos import STATE, Qos
from tombo_bag.schemas import schema_text, type_hash
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.time_base import SECOND_NS

FinalRecords: TypeAlias = Callable[[], Mapping[str, dict[str, str]]]


@dataclass(frozen=True)
class Columns:
    """Messages of one channel to be written together.

    Attributes:
        channel: number that `McapSink.add_channel` returned.
        log_times_ns: (N,) integers, when each message was recorded.
        messages: (N,) structured array whose items are the messages' bytes (`Layout.records`),
            or N messages of any length as bytes.
        publish_times_ns: (N,) integers; the log times if None.
    """

    channel: int
    log_times_ns: NDArray[Any]
    messages: NDArray[np.void] | Sequence[bytes]
    publish_times_ns: NDArray[Any] | None = None


@dataclass(frozen=True)
class _Written:
    """A chunk in the file: its index, messages per channel, checksum of all before it."""

    entry: ChunkIndex
    counts: dict[int, int]
    crc_before: int


class McapSink:
    """An open MCAP file. Use as a context manager: leaving it, by error or not, finishes the file.

    Not for use by several threads at once.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        compression: str = "zstd",
        chunk_span_ns: int = SECOND_NS,
        chunk_bytes: int = 4 << 20,
    ) -> None:
        """Create the file, or empty it if it is there.

        Args:
            path: file to write.
            compression: `zstd`, `lz4` or `none`.
            chunk_span_ns: log time after which a chunk is closed and handed to the system.
            chunk_bytes: size after which a chunk of single messages is closed earlier.

        Raises:
            InputError: unknown compression, or the file can't be created.
        """
        self.path = Path(path)
        self._compression = "" if compression == "none" else compression
        self._compress = _compressor(compression)
        self._span_ns = chunk_span_ns
        self._chunk_bytes = chunk_bytes
        self._offset = 0
        self._crc = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: list[Channel] = []
        self._topics: dict[str, tuple[str, int]] = {}
        self._unwritten: list[McapRecord] = []
        self._sequence: dict[int, int] = {}
        self._chunks: list[_Written] = []
        self.message_counts: Counter[int] = Counter()
        """Messages of each channel handed to the system so far."""
        self._metadata: list[MetadataIndex] = []
        self._waiting: list[tuple[int, int, int, bytes]] = []
        self._waiting_bytes = 0
        self.closed = False
        try:
            self._file = FileIO(self.path, "wb")
            try:
                self._put(MAGIC + _bytes(Header(profile="ros2", library="tombo_bag")))
            except OSError:
                self._file.close()
                self.path.unlink()
                raise
        except OSError as error:
            raise InputError(f"can't write '{self.path}': {error.strerror}") from error

    @property
    def size(self) -> int:
        """Bytes handed to the system so far."""
        return self._offset

    @property
    def span_ns(self) -> tuple[int, int]:
        """Log times of the first and the last of these messages; zeros if there is none."""
        entries = [chunk.entry for chunk in self._chunks]
        return (
            min((entry.message_start_time for entry in entries), default=0),
            max((entry.message_end_time for entry in entries), default=0),
        )

    def add_channel(self, topic: str, typename: str, qos: Qos = STATE) -> int:
        """Announce a topic; return the channel number under which its messages are written.

        Args:
            topic: name, as `/odometry`.
            typename: message type, as `nav_msgs/msg/Odometry`.
            qos: what the topic's publisher offers.

        Raises:
            InputError: unknown type, or the topic is there already with another type.
        """
        known = self._topics.get(topic)
        if known is not None:
            there, number = known
            if there != typename:
                raise InputError(f"topic '{topic}' has type {typename}; it is {there} already")
            return number
        metadata = {"offered_qos_profiles": qos.as_yaml(), "topic_type_hash": type_hash(typename)}
        self._check_open()
        schema = self._schemas.get(typename)
        if schema is None:
            text = schema_text(typename).encode()
            schema = Schema(len(self._schemas) + 1, text, "ros2msg", typename)
            self._schemas[typename] = schema
            self._unwritten.append(schema)
        channel = Channel(len(self._channels) + 1, topic, "cdr", metadata, schema.id)
        self._channels.append(channel)
        self._topics[topic] = (typename, channel.id)
        self._sequence[channel.id] = 0
        self._unwritten.append(channel)
        return channel.id

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write named text values beside the messages."""
        self._check_open()
        record = _bytes(Metadata(name=name, metadata=values))
        offset = self._offset
        self._put(record)
        self._metadata.append(MetadataIndex(offset, len(record), name))

    def write(
        self, channel: int, message: bytes, log_time_ns: int, publish_time_ns: int | None = None
    ) -> None:
        """Write one message.

        Args:
            channel: number that `add_channel` returned.
            message: its bytes, CDR with the four bytes of encapsulation.
            log_time_ns: when it was recorded.
            publish_time_ns: when it was published; the log time if None.
        """
        self._next_sequence(channel)
        sent = log_time_ns if publish_time_ns is None else publish_time_ns
        if not 0 <= min(log_time_ns, sent) <= max(log_time_ns, sent) < 1 << 64:
            raise InputError(
                f"channel {channel}: log time {log_time_ns}, publish time {sent}; "
                "accepted: integers from 0 to 2^64 - 1, in ns"
            )
        if self._waiting:
            span = abs(log_time_ns - self._waiting[0][1])
            if span >= self._span_ns or self._waiting_bytes >= self._chunk_bytes:
                self.flush()
        self._waiting.append((channel, log_time_ns, sent, message))
        self._waiting_bytes += len(message)

    def write_columns(self, *columns: Columns) -> None:
        """Write whole columns, merged by log time.

        The channels of one flight belong in one call: each call begins and ends its own chunks.

        Raises:
            InputError: unknown channel, columns of different length, or times that are no
                integers from 0 up.
        """
        self.flush()
        self._write_columns(columns)

    def _write_columns(self, columns: Sequence[Columns]) -> None:
        sources: list[Source] = []
        for column in columns:
            sequence = self._next_sequence(column.channel)
            times, sent = column.log_times_ns, column.publish_times_ns
            sources.append(source_of(column.channel, times, column.messages, sent, sequence))
            self._sequence[column.channel] += len(column.messages)
        self._write_chunks(sources)

    def flush(self) -> None:
        """Hand waiting single messages to the system as a chunk of their own.

        A recorder calls this when no message has come for a while.
        """
        self._check_open()
        by_channel: dict[int, list[tuple[int, int, bytes]]] = {}
        for channel, log, sent, message in self._waiting:
            by_channel.setdefault(channel, []).append((log, sent, message))
        self._write_columns([_columns(channel, rows) for channel, rows in by_channel.items()])
        self._waiting, self._waiting_bytes = [], 0

    def close(self, final_records: FinalRecords | None = None) -> None:
        """Finish the file: last chunk, indexes, statistics, footer. A second call does nothing.

        If there is no space for these, the newest chunks give way to them.

        Args:
            final_records: returns metadata to write, name → values. Called when all messages are
                written, and again when messages had to be removed.
        """
        if self.closed:
            return
        try:
            try:
                self.flush()
            finally:
                self._finish_on_full_disk(final_records)
        finally:
            self.closed = True
            self._file.close()

    def __enter__(self) -> McapSink:
        """Return the sink itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Finish the file, whatever happened."""
        self.close()

    def _next_sequence(self, channel: int) -> int:
        """Return the number of a channel's next message; refuse an unknown channel."""
        self._check_open()
        if channel not in self._sequence:
            raise unknown_name("channel", channel, map(str, self._sequence))
        return self._sequence[channel]

    def _check_open(self) -> None:
        if self.closed:
            raise ValueError(f"'{self.path}' is closed")

    def _write_chunks(self, sources: list[Source]) -> None:
        for part in slices(sources, self._span_ns):
            prefix = _bytes(*self._unwritten)
            body = assemble(prefix, part)
            data = self._compress(body.data)
            chunk = _bytes(
                Chunk(
                    compression=self._compression,
                    data=data,
                    message_start_time=body.start_ns,
                    message_end_time=body.end_ns,
                    uncompressed_crc=zlib.crc32(body.data),
                    uncompressed_size=len(body.data),
                )
            )
            index = RecordBuilder()
            places: dict[int, int] = {}
            for channel, rows in body.index.items():
                places[channel] = self._offset + len(chunk) + index.count
                write_message_index(index, channel, rows)
            entry = ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=self._offset,
                compression=self._compression,
                compressed_size=len(data),
                message_end_time=body.end_ns,
                message_index_length=index.count,
                message_index_offsets=places,
                message_start_time=body.start_ns,
                uncompressed_size=len(body.data),
            )
            counts = {c: len(rows) for c, rows in body.index.items()}
            written = _Written(entry, counts, self._crc)
            self._put(chunk + index.end())
            self._chunks.append(written)
            self.message_counts.update(counts)
            self._unwritten = []

    def _finish_on_full_disk(self, final_records: FinalRecords | None) -> None:
        metadata = list(self._metadata)
        too_many = 1
        while True:
            try:
                for name, values in (final_records() if final_records else {}).items():
                    self.add_metadata(name, values)
                self._finish()
                return
            except OSError:
                if not self._chunks:
                    raise
                given_up = self._chunks[-too_many:]
                end = given_up[0].entry.chunk_start_offset
                for chunk in given_up:
                    self.message_counts.subtract(chunk.counts)
                del self._chunks[-too_many:]
                too_many *= 2
                self._offset, self._crc = end, given_up[0].crc_before
                self._metadata = [record for record in metadata if record.offset < end]

    def _finish(self) -> None:
        """Write what the `mcap` library's writer writes last, in its order."""
        self._put(_bytes(*self._unwritten))
        self._unwritten = []
        self._put(_bytes(DataEnd(self._crc)))
        start = self._offset
        groups: list[tuple[int, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels)),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [chunk.entry for chunk in self._chunks]),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        summary = bytearray()
        offsets: list[McapRecord] = []
        for opcode, records in groups:
            if records:
                group = _bytes(*records)
                offsets.append(SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        offset_start = start + len(summary)
        summary += _bytes(*offsets)
        footer = _bytes(Footer(start, offset_start, 0))
        checksum = zlib.crc32(footer[:-4], zlib.crc32(summary))
        self._put(summary + _bytes(Footer(start, offset_start, checksum)) + MAGIC)

    def _statistics(self) -> Statistics:
        counts = +self.message_counts
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(sorted(counts.items())),
            chunk_count=len(self._chunks),
            message_count=counts.total(),
            message_end_time=self.span_ns[1],
            message_start_time=self.span_ns[0],
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _put(self, data: bytes | bytearray) -> None:
        """Append to the file, whole or not at all: a write that fails leaves no half record."""
        if self._file.tell() != self._offset:
            self._file.seek(self._offset)
            self._file.truncate()
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
        self._crc = zlib.crc32(data, self._crc)
        self._offset += len(data)


def _columns(channel: int, rows: Sequence[tuple[int, int, bytes]]) -> Columns:
    log, sent, messages = zip(*rows, strict=True)
    return Columns(channel, np.array(log, np.uint64), messages, np.array(sent, np.uint64))


def _bytes(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data


def _compressor(name: str) -> Callable[[bytes], bytes]:
    """Return the function for a compression. Level 1 of zstd: more takes longer for little."""
    if name == "zstd":
        import zstandard

        pack = zstandard.ZstdCompressor(level=1)
        return lambda data: bytes(pack.compress(data))
    if name == "lz4":
        import lz4.frame

        compress: Callable[[bytes], bytes] = lz4.frame.compress
        return compress
    if name == "none":
        return bytes
    raise unknown_name("compression", name, ["zstd", "lz4", "none"])

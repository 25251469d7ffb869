"""Writes an MCAP file of ROS 2 messages, whole columns of them at once.

The headless flight writes a whole flight at once, a recorder half a second. Chunks hold at most
one second of log time and go to the system at once: all that a killed process wrote stays
readable. Headers, indexes and summary are the `mcap` library's own records.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import zstandard
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

from tombo_bag.formats.chunks import HEAD, MAGIC, PREFIX_SIZE, chunk_bodies, write_message_index
from tombo_bag.qos import STATE, Qos
from tombo_bag.schemas import schema_text, type_hash
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.time_base import SECOND_NS

COMPRESSION = "zstd"
_LEVEL = 1
"""Level of zstd: a higher one takes longer and saves little."""


@dataclass(frozen=True)
class Columns:
    """Messages of one channel to be written together.

    Attributes:
        channel: number that `McapSink.add_channel` returned.
        log_times_ns: N integers, when each message was recorded.
        messages: (N,) structured array whose items are the messages' bytes (`Layout.records`),
            or N messages of any length as bytes.
        publish_times_ns: N integers; the log times if None.
    """

    channel: int
    log_times_ns: NDArray[Any] | Sequence[int]
    messages: NDArray[np.void] | Sequence[bytes]
    publish_times_ns: NDArray[Any] | Sequence[int] | None = None


class McapSink:
    """An open MCAP file. Use as a context manager: leaving it, by error or not, finishes the file.

    Not for use by several threads at once.
    """

    def __init__(
        self,
        path: str | Path,
        records: Mapping[str, Mapping[str, str]] = MappingProxyType({}),
        *,
        chunk_span_ns: int = SECOND_NS,
    ) -> None:
        """Create the file, or empty it if it is there.

        Args:
            path: file to write.
            records: metadata records to begin it with: name → values.
            chunk_span_ns: log time after which a chunk is closed and handed to the system.

        Raises:
            InputError: the file can't be created.
        """
        self.path = Path(path)
        self.closed = False
        self.size = 0
        """Bytes handed to the system so far."""
        self.message_counts: Counter[int] = Counter()
        """Messages of each channel handed to the system so far."""
        self._span_ns = chunk_span_ns
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)
        self._crc = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[str, Channel] = {}
        self._unwritten: list[McapRecord] = []
        self._taken: dict[int, int] = {}
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        try:
            self._file = FileIO(self.path, "wb")
            try:
                self._put(MAGIC + _bytes(Header(profile="ros2", library="tombo_bag")))
                for name, values in records.items():
                    self.add_metadata(name, values)
            except OSError:
                self._file.close()
                self.path.unlink()
                raise
        except OSError as error:
            raise InputError(f"can't write '{self.path}': {error.strerror}") from error

    @property
    def span_ns(self) -> tuple[int, int]:
        """Log times of the first and the last message written; zeros if there is none."""
        return (
            min((chunk.message_start_time for chunk in self._chunks), default=0),
            max((chunk.message_end_time for chunk in self._chunks), default=0),
        )

    def add_channel(self, topic: str, typename: str, qos: Qos = STATE) -> int:
        """Announce a topic; return the channel number under which its messages are written.

        Args:
            topic: name, as `/odometry`.
            typename: message type, as `nav_msgs/msg/Odometry`.
            qos: the offer of the topic's publisher.

        Raises:
            InputError: unknown type, or the topic is there already with another type.
        """
        known = self._channels.get(topic)
        if known is not None:
            if known.schema_id != getattr(self._schemas.get(typename), "id", None):
                there = next(n for n, s in self._schemas.items() if s.id == known.schema_id)
                raise InputError(f"topic '{topic}' has type {typename}; it is {there} already")
            return known.id
        self._check_open()
        metadata = {"offered_qos_profiles": qos.as_yaml(), "topic_type_hash": type_hash(typename)}
        schema = self._schemas.get(typename)
        if schema is None:
            text = schema_text(typename).encode()
            schema = Schema(len(self._schemas) + 1, text, "ros2msg", typename)
            self._schemas[typename] = schema
            self._unwritten.append(schema)
        channel = Channel(len(self._channels) + 1, topic, "cdr", metadata, schema.id)
        self._channels[topic] = channel
        self._taken[channel.id] = 0
        self._unwritten.append(channel)
        return channel.id

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record of text values at once, between the chunks.

        Raises:
            ValueError: the file is closed.
            OSError: the disk is full or failed.
        """
        self._check_open()
        record = _bytes(Metadata(name=name, metadata=dict(values)))
        index = MetadataIndex(self.size, len(record), name)
        self._put(record)
        self._metadata.append(index)

    def write_columns(self, *columns: Columns) -> None:
        """Write whole columns, merged by log time.

        The channels of one flight belong in one call: each call begins and ends its own chunks.

        Raises:
            InputError: unknown channel, columns of different length, or times other than
                integers from 0 up.
            OSError: the disk is full or failed. Earlier chunks are whole.
        """
        self._check_open()
        records = []
        for column in columns:
            self._check(column.channel)
            records.append(_message_records(column, self._taken[column.channel]))
            self._taken[column.channel] += len(column.messages)
        for body in chunk_bodies(records, self._span_ns, _bytes(*self._unwritten)):
            data = self._compressor.compress(body.data)
            start, end, size = body.start_ns, body.end_ns, len(body.data)
            chunk = _bytes(Chunk(COMPRESSION, data, end, start, zlib.crc32(body.data), size))
            index = RecordBuilder()
            places: dict[int, int] = {}
            for channel, rows in body.index.items():
                places[channel] = self.size + len(chunk) + index.count
                write_message_index(index, channel, rows)
            entry = ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=self.size,
                compression=COMPRESSION,
                compressed_size=len(data),
                message_end_time=end,
                message_index_length=index.count,
                message_index_offsets=places,
                message_start_time=start,
                uncompressed_size=size,
            )
            self._put(chunk + index.end())
            self._chunks.append(entry)
            self.message_counts.update({c: len(rows) for c, rows in body.index.items()})
            self._unwritten = []

    def close(self) -> None:
        """Finish the file: indexes, statistics, footer. A second call does nothing.

        Raises:
            OSError: the disk is full or failed. All chunks are whole and can be read, also
                without indexes and footer.
        """
        if self.closed:
            return
        try:
            self._finish()
        finally:
            self.closed = True
            self._file.close()

    def __enter__(self) -> McapSink:
        """Return the sink itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Finish the file, whatever happened."""
        self.close()

    def _check(self, channel: int) -> None:
        self._check_open()
        if channel not in self._taken:
            raise unknown_name("channel", channel, map(str, self._taken))

    def _check_open(self) -> None:
        if self.closed:
            raise ValueError(f"'{self.path}' is closed")

    def _finish(self) -> None:
        """Write what the `mcap` library's writer writes last, in its order."""
        self._put(_bytes(*self._unwritten))
        self._put(_bytes(DataEnd(self._crc)))
        start = self.size
        groups: list[tuple[int, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
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
        first_ns, last_ns = self.span_ns
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(sorted(self.message_counts.items())),
            chunk_count=len(self._chunks),
            message_count=self.message_counts.total(),
            message_end_time=last_ns,
            message_start_time=first_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _put(self, data: bytes | bytearray) -> None:
        """Append to the file, whole or not at all: a write that fails leaves no half record."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError:
            self._file.seek(self.size)
            self._file.truncate()
            raise
        self._crc = zlib.crc32(data, self._crc)
        self.size += len(data)


def _message_records(column: Columns, first_sequence: int) -> tuple[NDArray[np.void], list[bytes]]:
    """Return heads (N,) of HEAD of messages and their MCAP records, by log time.

    `first_sequence` is the sequence number of the first message.

    Raises:
        InputError: lengths differ, or a time is negative or no integer.
    """
    channel, logged, messages = column.channel, column.log_times_ns, column.messages
    publish = logged if column.publish_times_ns is None else column.publish_times_ns
    if not len(logged) == len(messages) == len(publish):
        raise InputError(
            f"channel {channel}: {len(logged)} log times, {len(publish)} publish times, "
            f"{len(messages)} messages; accepted: the same number of each"
        )
    heads: NDArray[np.void] = np.empty(len(messages), HEAD)
    heads["opcode"] = Opcode.MESSAGE
    heads["channel"] = channel
    heads["log_time"] = _times(logged, channel)
    heads["publish_time"] = _times(publish, channel)
    order = np.argsort(heads["log_time"], kind="stable")
    heads = heads[order]
    heads["sequence"] = np.arange(len(heads)) + first_sequence
    if isinstance(messages, np.ndarray):
        # numpy copies only the named fields of a structured array; as plain bytes, it copies all
        messages = np.ascontiguousarray(messages.view(f"V{messages.dtype.itemsize}")).tolist()
    in_order = [messages[i] for i in order.tolist()]
    sizes = np.fromiter(map(len, in_order), np.uint64, len(in_order))
    heads["length"] = np.uint64(HEAD.itemsize - PREFIX_SIZE) + sizes
    pairs = zip(heads.view(f"V{HEAD.itemsize}").tolist(), in_order, strict=True)
    return heads, [head + message for head, message in pairs]


def _times(times: NDArray[Any] | Sequence[int], channel: int) -> NDArray[np.uint64]:
    """Return times (N,) [ns] as MCAP has them; refuse what it can't hold."""
    given = np.asarray(times)
    if given.dtype.kind not in "iu" or (given.size and given.min() < 0):
        raise InputError(
            f"channel {channel}: times of type {given.dtype}; accepted: integers from 0 up, in ns"
        )
    return given.astype(np.uint64)


def _bytes(*records: McapRecord) -> bytes:
    """Return records as the file has them."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data

"""Messages of many channels put together, in order of log time, into the body of an MCAP chunk.

The library's writer spends 3 to 10 µs on a message. A flight has some 180 000, so here whole
columns are turned into message records by numpy, cut apart, sorted and joined: 0.2 µs each.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

from tombo_dynamics.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of an MCAP file. (To import the library's writer for it takes 25 ms.)"""

HEAD = np.dtype(
    {
        "names": ["opcode", "length", "channel", "sequence", "log_time", "publish_time"],
        "formats": ["u1", "<u8", "<u2", "<u4", "<u8", "<u8"],
        "offsets": [0, 1, 9, 11, 15, 23],
        "itemsize": 31,
    }
)
"""What stands before a message's own bytes in an MCAP file: head of record and of message."""

_HEAD = struct.Struct("<BQHIQQ")
PREFIX_SIZE = 9
"""Opcode and length: the part of HEAD that `length` does not count."""


@dataclass(frozen=True)
class Source:
    """Messages of one or more channels, sorted by log time.

    Attributes:
        log_times_ns: (N,).
        channels: (N,).
        records: returns the MCAP message records from one up to, not including, another.
    """

    log_times_ns: NDArray[np.uint64]
    channels: NDArray[np.uint16]
    records: Callable[[int, int], list[bytes]]


def records_source(times_ns: Any, channels: Any, records: Sequence[bytes]) -> Source:
    """Return finished records, written one at a time, as a source."""
    times, numbers = np.array(times_ns, np.uint64), np.array(channels, np.uint16)
    return Source(times, numbers, lambda first, last: list(records[first:last]))


def _column_source(
    channel: int,
    log_ns: NDArray[np.uint64],
    publish_ns: NDArray[np.uint64],
    messages: NDArray[np.void],
    first_sequence: int,
) -> Source:
    """Return one channel's messages, (N,) items of plain bytes of one length, as a source."""
    size = messages.dtype.itemsize

    def records(first: int, last: int) -> list[bytes]:
        """Put a head before each message and cut the block into records."""
        head = np.empty(last - first, HEAD)
        head["opcode"] = Opcode.MESSAGE
        head["length"] = HEAD.itemsize - PREFIX_SIZE + size
        head["channel"] = channel
        head["sequence"] = np.arange(first, last) + first_sequence
        head["log_time"] = log_ns[first:last]
        head["publish_time"] = publish_ns[first:last]
        block = np.empty((last - first, HEAD.itemsize + size), np.uint8)
        block[:, : HEAD.itemsize] = head.view(np.uint8).reshape(len(block), -1)
        block[:, HEAD.itemsize :] = messages[first:last].view(np.uint8).reshape(len(block), -1)
        cut: list[bytes] = block.view(f"V{block.shape[1]}").ravel().tolist()
        return cut

    return Source(log_ns, np.full(len(log_ns), channel, np.uint16), records)


@dataclass(frozen=True)
class ChunkBody:
    """A chunk's records before compression, and where each channel's messages stand in it.

    Attributes:
        data: schema and channel records, then message records in order of log time.
        start_ns: log time of the first message.
        end_ns: log time of the last message.
        index: channel → (n, 2) array of log time and offset in `data`.
    """

    data: bytes
    start_ns: int
    end_ns: int
    index: dict[int, NDArray[np.uint64]]


def slices(sources: list[Source], span_ns: int) -> Iterator[list[tuple[Source, int, int]]]:
    """Cut sources into slices of at most `span_ns` of log time, each (source, first, last)."""
    position = [0] * len(sources)
    while True:
        ahead = [
            source.log_times_ns[at]
            for source, at in zip(sources, position, strict=True)
            if at < len(source.log_times_ns)
        ]
        if not ahead:
            return
        end = np.uint64(int(min(ahead)) + span_ns)
        part: list[tuple[Source, int, int]] = []
        for i, source in enumerate(sources):
            last = int(np.searchsorted(source.log_times_ns, end))
            if last > position[i]:
                part.append((source, position[i], last))
                position[i] = last
        yield part


def assemble(prefix: bytes, part: list[tuple[Source, int, int]]) -> ChunkBody:
    """Merge a slice of messages by log time; among equal times the earlier source comes first."""
    records: list[bytes] = []
    for source, first, last in part:
        records += source.records(first, last)
    times = np.concatenate([source.log_times_ns[a:b] for source, a, b in part])
    channels = np.concatenate([source.channels[a:b] for source, a, b in part])
    order = np.argsort(times, kind="stable")
    ordered = [records[i] for i in order.tolist()]
    sizes = np.fromiter(map(len, ordered), np.uint64, len(ordered))
    offsets = np.cumsum(sizes) - sizes + np.uint64(len(prefix))
    rows = np.stack([times[order], offsets], axis=1)
    owner = channels[order]
    return ChunkBody(
        data=b"".join((prefix, *ordered)),
        start_ns=int(rows[0, 0]),
        end_ns=int(rows[-1, 0]),
        index={int(channel): rows[owner == channel] for channel in np.unique(owner)},
    )


def write_message_index(stream: RecordBuilder, channel: int, rows: NDArray[np.uint64]) -> None:
    """Append a message index record; the library's own loops over its entries."""
    stream.start_record(Opcode.MESSAGE_INDEX)
    stream.write2(channel)
    stream.write4(rows.size * 8)
    stream.write(rows.astype("<u8").tobytes())
    stream.finish_record()


def source_of(
    channel: int,
    log_times_ns: NDArray[Any],
    messages: NDArray[np.void] | Sequence[bytes],
    publish_times_ns: NDArray[Any] | None,
    first_sequence: int,
) -> Source:
    """Check one channel's messages and sort them by log time where they are not.

    Raises:
        InputError: lengths differ, or a time is negative or no integer.
    """
    publish = log_times_ns if publish_times_ns is None else publish_times_ns
    if not len(log_times_ns) == len(messages) == len(publish):
        raise InputError(
            f"channel {channel}: {len(log_times_ns)} log times, {len(publish)} publish times, "
            f"{len(messages)} messages; accepted: the same number of each"
        )
    log, published = _times(log_times_ns, channel), _times(publish, channel)
    order = np.argsort(log, kind="stable") if np.any(log[1:] < log[:-1]) else None
    if order is not None:
        log, published = log[order], published[order]
    if isinstance(messages, np.ndarray):
        # numpy copies only the named fields of a structured array; as plain bytes, it copies all
        plain = messages.view(f"V{messages.dtype.itemsize}")
        block = np.ascontiguousarray(plain if order is None else plain[order])
        return _column_source(channel, log, published, block, first_sequence)
    places = range(len(messages)) if order is None else order.tolist()
    records = [
        message_record(channel, first_sequence + i, time, sent, messages[place])
        for i, (place, time, sent) in enumerate(
            zip(places, log.tolist(), published.tolist(), strict=True)
        )
    ]
    return records_source(log, np.full(len(records), channel), records)


def message_record(
    channel: int, sequence: int, log_time_ns: int, publish_time_ns: int, message: bytes
) -> bytes:
    """Put the head before one message.

    Raises:
        InputError: a time is negative or past the year 2554.
    """
    length = HEAD.itemsize - PREFIX_SIZE + len(message)
    try:
        head = _HEAD.pack(
            Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_time_ns, publish_time_ns
        )
    except struct.error as error:
        raise InputError(
            f"channel {channel}: log time {log_time_ns}, publish time {publish_time_ns}; "
            "accepted: integers from 0 to 2^64 - 1, in ns"
        ) from error
    return head + message


def _times(times: NDArray[Any], channel: int) -> NDArray[np.uint64]:
    given = np.asarray(times)
    if given.dtype.kind not in "iu" or (given.size and given.min() < 0):
        raise InputError(
            f"channel {channel}: times of type {given.dtype}; accepted: integers from 0 up, in ns"
        )
    return given.astype(np.uint64)

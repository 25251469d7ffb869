"""Messages of many channels put together, in order of log time, into the body of an MCAP chunk.

The library's writer spends 3 to 10 µs on a message. A flight has some 180 000, so here whole
columns are turned into message records by numpy, cut apart, sorted and joined: 0.2 µs each.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

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
"""Bytes before a message's own in an MCAP file: head of record and of message."""

PREFIX_SIZE = 9
"""Opcode and length: the part of HEAD that `length` does not count."""


@dataclass(frozen=True)
class ChunkBody:
    """A chunk's records before compression, and the offsets of each channel's messages.

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


def chunk_bodies(
    columns: Iterable[tuple[NDArray[np.void], list[bytes]]], span_ns: int, prefix: bytes
) -> Iterator[ChunkBody]:
    """Merge records by log time; among equal times the earlier column comes first.

    Args:
        columns: heads (N,) of HEAD and message records of each channel, by log time.
        span_ns: log time after which a chunk ends.
        prefix: schema and channel records, for the first chunk.
    """
    parts = list(columns)
    heads = np.concatenate([np.empty(0, HEAD), *(of for of, _ in parts)])
    records = [record for _, of in parts for record in of]
    order = np.argsort(heads["log_time"], kind="stable")
    times, owners = heads["log_time"][order], heads["channel"][order]
    first = 0
    while first < len(order):
        last = int(np.searchsorted(times, times[first] + np.uint64(span_ns)))
        ordered = [records[i] for i in order[first:last].tolist()]
        sizes = np.fromiter(map(len, ordered), np.uint64, len(ordered))
        offsets = np.cumsum(sizes) - sizes + np.uint64(len(prefix))
        rows, owner = np.stack([times[first:last], offsets], axis=1), owners[first:last]
        yield ChunkBody(
            data=b"".join((prefix, *ordered)),
            start_ns=int(times[first]),
            end_ns=int(times[last - 1]),
            index={int(channel): rows[owner == channel] for channel in np.unique(owner)},
        )
        first, prefix = last, b""


def write_message_index(stream: RecordBuilder, channel: int, rows: NDArray[np.uint64]) -> None:
    """Append the message index record of a channel, as the MCAP format has it.

    The library's own writes entry by entry; here all go at once.

    Args:
        stream: to append to.
        channel: number of the channel.
        rows: (n, 2) log time [ns], and offset of the message's record in the chunk's body [bytes].
    """
    stream.start_record(Opcode.MESSAGE_INDEX)
    stream.write2(channel)
    stream.write4(rows.size * 8)  # bytes that follow: each number has 8
    stream.write(rows.astype("<u8").tobytes())
    stream.finish_record()

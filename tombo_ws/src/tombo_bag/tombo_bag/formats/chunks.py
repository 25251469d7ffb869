"""Messages of many channels put together, in order of log time, into the body of an MCAP chunk.

The library's writer spends 3 to 10 µs on a message. A flight has some 180 000, so here whole
columns are turned into message records by numpy, cut apart, sorted and joined: 0.2 µs each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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

PREFIX_SIZE = 9
"""Opcode and length: the part of HEAD that `length` does not count."""


@dataclass(frozen=True)
class Source:
    """Messages of one channel, sorted by log time.

    Attributes:
        heads: (N,) of HEAD.
        messages: N messages as bytes, or (N,) items of plain bytes of one length.
    """

    heads: NDArray[np.void]
    messages: NDArray[np.void] | list[bytes]

    def records(self, first: int, last: int) -> list[bytes]:
        """Return the MCAP message records from one up to, not including, another."""
        heads, messages = self.heads[first:last], self.messages[first:last]
        if isinstance(messages, list):
            plain = heads.view(f"V{HEAD.itemsize}").tolist()
            return [head + message for head, message in zip(plain, messages, strict=True)]
        block = np.hstack(
            [part.view(np.uint8).reshape(last - first, -1) for part in (heads, messages)]
        )
        cut: list[bytes] = block.view(f"V{block.shape[1]}").ravel().tolist()
        return cut


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
    times = [source.heads["log_time"] for source in sources]
    position = [0] * len(sources)
    while ahead := [of[at] for of, at in zip(times, position, strict=True) if at < len(of)]:
        end = np.uint64(int(min(ahead)) + span_ns)
        before, position = position, [int(np.searchsorted(of, end)) for of in times]
        rows = zip(sources, before, position, strict=True)
        yield [(source, first, last) for source, first, last in rows if last > first]


def assemble(prefix: bytes, part: list[tuple[Source, int, int]]) -> ChunkBody:
    """Merge a slice of messages by log time; among equal times the earlier source comes first."""
    records = [record for source, a, b in part for record in source.records(a, b)]
    heads = np.concatenate([source.heads[["channel", "log_time"]][a:b] for source, a, b in part])
    order = np.argsort(heads["log_time"], kind="stable")
    ordered = [records[i] for i in order.tolist()]
    sizes = np.fromiter(map(len, ordered), np.uint64, len(ordered))
    offsets = np.cumsum(sizes) - sizes + np.uint64(len(prefix))
    rows = np.stack([heads["log_time"][order], offsets], axis=1)
    owner = heads["channel"][order]
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
    heads: NDArray[np.void] = np.empty(len(messages), HEAD)
    heads["opcode"] = Opcode.MESSAGE
    heads["channel"] = channel
    heads["log_time"], heads["publish_time"] = (
        _times(log_times_ns, channel),
        _times(publish, channel),
    )
    order = np.argsort(heads["log_time"], kind="stable")
    heads = heads[order]
    heads["sequence"] = np.arange(len(heads)) + first_sequence
    in_order: NDArray[np.void] | list[bytes]
    if isinstance(messages, np.ndarray):
        # numpy copies only the named fields of a structured array; as plain bytes, it copies all
        in_order = np.ascontiguousarray(messages.view(f"V{messages.dtype.itemsize}")[order])
        sizes: Any = in_order.dtype.itemsize
    else:
        in_order = [messages[i] for i in order.tolist()]
        sizes = np.fromiter(map(len, in_order), np.uint64, len(in_order))
    heads["length"] = HEAD.itemsize - PREFIX_SIZE + sizes
    return Source(heads, in_order)


def _times(times: NDArray[Any], channel: int) -> NDArray[np.uint64]:
    given = np.asarray(times)
    if given.dtype.kind not in "iu" or (given.size and given.min() < 0):
        raise InputError(
            f"channel {channel}: times of type {given.dtype}; accepted: integers from 0 up, in ns"
        )
    return given.astype(np.uint64)

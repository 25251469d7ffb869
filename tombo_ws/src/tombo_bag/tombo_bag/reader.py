"""Reads an MCAP file of ROS 2 messages as columns; of a damaged file, all that is whole."""

from __future__ import annotations

import mmap
import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.records import Channel, Metadata, Schema
from numpy.typing import NDArray

from tombo_bag.chunks import MAGIC
from tombo_bag.columns import ColumnTable, columns_of
from tombo_bag.scan import (
    ChunkPlace,
    Damage,
    extract_messages,
    index_chunk,
    open_chunk,
    refine_truncation,
    walk,
)
from tombo_bag.schemas import parse_schema
from tombo_dynamics.errors import InputError, unknown_name

MAPPED_FROM = 1 << 30
"""Files above this size [bytes] are mapped; below, read: a mapped file must not be rewritten."""


@dataclass(frozen=True)
class Topic:
    """One topic of a file.

    Attributes:
        name: as `/odometry`.
        typename: message type, as `nav_msgs/msg/Odometry`.
        count: number of messages that can be read.
        first_ns: log time of the first of them, 0 if there is none.
        last_ns: log time of the last of them, 0 if there is none.
    """

    name: str
    typename: str
    count: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True)
class RawMessages:
    """Messages of one channel in order of log time, not taken apart."""

    log_times_ns: NDArray[np.int64]
    publish_times_ns: NDArray[np.int64]
    messages: list[bytes]


class Bag:
    """An MCAP file, read. `damage` lists what could not be read of it."""

    def __init__(self, path: str | Path, *, check: bool = False) -> None:
        """Find out what is in a file.

        Args:
            path: MCAP file.
            check: decompress and check every chunk now, not when it is first needed.

        Raises:
            InputError: the file is missing, empty or no MCAP file.
        """
        self.path = Path(path)
        self._found = walk(_contents(self.path))
        unannounced = not self._found.finished or not self._found.channels
        for place in self._found.chunks:
            if place.offset and (check or unannounced or place.index is None):
                place.index, _ = index_chunk(self._open(place), self._found)
                if not place.whole:
                    refine_truncation(self._found, place)

    @property
    def damage(self) -> tuple[Damage, ...]:
        """What could not be read so far; complete after `check` or after all topics are read."""
        return tuple(self._found.damage)

    @property
    def schemas(self) -> dict[int, Schema]:
        """Schema records by number."""
        return dict(self._found.schemas)

    @property
    def channels(self) -> dict[int, Channel]:
        """Channel records by number."""
        return dict(self._found.channels)

    @property
    def metadata(self) -> tuple[Metadata, ...]:
        """Metadata records, in order."""
        return tuple(self._found.metadata)

    @property
    def topics(self) -> dict[str, Topic]:
        """The topics by name, sorted."""
        table: dict[str, Topic] = {}
        for name in sorted({channel.topic for channel in self._found.channels.values()}):
            numbers = self._channels_of(name)
            rows = [
                place.index[number][:, 0]
                for place in self._found.chunks
                for number in numbers
                if place.index and number in place.index and len(place.index[number])
            ]
            schema = self._found.schemas.get(self._found.channels[numbers[0]].schema_id)
            table[name] = Topic(
                name,
                schema.name if schema else "",
                sum(map(len, rows)),
                min((int(times.min()) for times in rows), default=0),
                max((int(times.max()) for times in rows), default=0),
            )
        return table

    def columns(self, topic: str) -> ColumnTable:
        """Read a topic's messages as columns, in order of log time.

        Returns:
            Path of each number and string → array with a row per message (see
            `columns.columns_of`), with `log_time_ns`, `publish_time_ns` and, for messages with a
            header, `stamp_ns`. All times are int64 nanoseconds.

        Raises:
            InputError: no such topic, or its messages are not CDR with a `ros2msg` schema.
        """
        numbers = self._channels_of(topic)
        channel = self._found.channels[numbers[0]]
        schema = self._found.schemas.get(channel.schema_id)
        if schema is None or schema.encoding != "ros2msg" or channel.message_encoding != "cdr":
            encoding = schema.encoding if schema else "none"
            raise InputError(
                f"'{self.path}': topic {topic} has messages in '{channel.message_encoding}' with "
                f"schema '{encoding}'; accepted: 'cdr' with 'ros2msg'"
            )
        raw = self.messages(*numbers)
        types = parse_schema(schema.name, schema.data.decode("utf-8", "replace"))
        try:
            table = columns_of(schema.name, raw.messages, types)
        except InputError as error:
            raise InputError(f"'{self.path}': topic {topic}: {error}") from error
        return {
            "log_time_ns": raw.log_times_ns,
            "publish_time_ns": raw.publish_times_ns,
            **table,
        }

    def messages(self, *channels: int) -> RawMessages:
        """Read the bytes of some channels' messages, in order of log time."""
        return self.message_groups(channels)[0]

    def message_groups(self, *groups: Collection[int]) -> list[RawMessages]:
        """Read several groups of channels, each chunk opened once; otherwise as `messages`."""
        group_of = {number: i for i, group in enumerate(groups) for number in group}
        heads: list[list[NDArray[np.void]]] = [[] for _ in groups]
        messages: list[list[bytes]] = [[] for _ in groups]
        for number, head, part in self._pieces(tuple(group_of)):
            heads[group_of[number]].append(head)
            messages[group_of[number]] += part
        return [_in_order(*group) for group in zip(heads, messages, strict=True)]

    def _pieces(
        self, channels: tuple[int, ...]
    ) -> Iterator[tuple[int, NDArray[np.void], list[bytes]]]:
        for place in self._found.chunks:
            wanted = [number for number in channels if number in (place.index or {})]
            if not wanted:
                continue
            data = self._open(place)
            for number in wanted:
                rows = (place.index or {}).get(number)
                if rows is None:
                    continue
                piece = extract_messages(data, number, rows[:, 1])
                if piece is None:
                    place.index, _ = index_chunk(data, self._found)
                    piece = extract_messages(data, number, place.index.get(number, rows[:0])[:, 1])
                if piece is not None:
                    yield number, *piece

    def _open(self, place: ChunkPlace) -> bytes | memoryview:
        data, damage = open_chunk(place)
        if damage is not None:
            place.index = {}
            if all(known.offset != damage.offset for known in self._found.damage):
                self._found.damage.append(damage)
        return data

    def _channels_of(self, topic: str) -> list[int]:
        numbers = [n for n, channel in self._found.channels.items() if channel.topic == topic]
        if not numbers:
            names = {channel.topic for channel in self._found.channels.values()}
            raise unknown_name(f"topic in '{self.path}'", topic, names)
        return numbers


def _in_order(heads: list[NDArray[np.void]], messages: list[bytes]) -> RawMessages:
    if not heads:
        return RawMessages(np.zeros(0, np.int64), np.zeros(0, np.int64), [])
    head = np.concatenate(heads)
    log = head["log_time"].astype(np.int64)
    publish = head["publish_time"].astype(np.int64)
    if np.any(log[1:] < log[:-1]):
        order = np.argsort(log, kind="stable")
        log, publish = log[order], publish[order]
        messages = [messages[i] for i in order.tolist()]
    return RawMessages(log, publish, messages)


def _contents(path: Path) -> memoryview:
    """Map a file into memory and check that it is an MCAP file.

    Raises:
        InputError: it is missing, a folder, not readable, empty, or begins like no MCAP file.
    """
    try:
        with path.open("rb") as file:
            start = file.read(len(MAGIC))
            if not start:
                raise InputError(f"'{path}' is empty; accepted: an MCAP file")
            if start != MAGIC[: len(start)]:
                found = start.hex(" ")
                raise InputError(f"'{path}' starts with bytes {found}; accepted: an MCAP file")
            file.seek(0, os.SEEK_END)
            if file.tell() > MAPPED_FROM:
                return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
            return memoryview(path.read_bytes())
    except IsADirectoryError as error:
        raise InputError(f"'{path}' is a folder; accepted: an MCAP file") from error
    except OSError as error:
        raise InputError(f"can't read '{path}': {error.strerror}") from error


__all__ = ["Bag", "Damage", "RawMessages", "Topic"]

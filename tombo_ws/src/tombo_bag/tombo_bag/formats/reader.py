"""Reads an MCAP file of ROS 2 messages as columns; of a damaged file, all that is whole."""

from __future__ import annotations

import mmap
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mcap.records import Channel
from numpy.typing import NDArray

from tombo_bag.formats.bag_files import BagFile, RawMessages, TopicSummary, in_log_order
from tombo_bag.formats.chunks import HEAD, MAGIC
from tombo_bag.formats.scan import ChunkPlace, extract_messages, index_chunk, open_chunk, walk
from tombo_bag.schemas import Types, parse_schema, ros1_as_cdr, ros1_store
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_ROS1 = "ros1"
"""Encoding of messages that a ROS 1 bag, converted to MCAP, has."""
_MAPPED_FROM = 1 << 30
"""Files above this size [bytes] are mapped; below, read: a mapped file must not be rewritten."""


class Bag(BagFile):
    """An MCAP file, read. `damage` is complete after `check` or after all topics are read."""

    def __init__(self, path: str | Path, *, check: bool = False) -> None:
        """Find out what is in a file.

        Args:
            path: MCAP file.
            check: decompress and check every chunk now, not when it is first needed.

        Raises:
            InputError: the file is missing, empty or no MCAP file.
        """
        self.path = Path(path)
        contents = _contents(self.path)
        self._map = walk(contents)
        self.damage: list[str] = self._map.damage
        unannounced = not self._map.finished or not self._map.channels
        for place in self._map.chunks:
            if place.offset and (check or unannounced or place.index is None):
                place.index = index_chunk(self._open(place), self._map)
        self.metadata = {record.name: record.metadata for record in self._map.metadata}
        self._numbers: dict[str, list[int]] = {}
        for number, channel in self._map.channels.items():
            self._numbers.setdefault(channel.topic, []).append(number)
        self.topics = self._streams()

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics, each chunk once."""
        here = [topic for topic in topics if topic in self.topics]
        topic_of = {number: topic for topic in here for number in self._numbers[topic]}
        heads: dict[str, list[NDArray[np.void]]] = {topic: [] for topic in here}
        messages: dict[str, list[bytes]] = {topic: [] for topic in here}
        for number, head, part in self._pieces(tuple(topic_of)):
            heads[topic_of[number]].append(head)
            messages[topic_of[number]] += part
        for topic in here:
            if self._channel(topic).message_encoding == _ROS1:
                store, typename = self._ros1_store(topic), self.topics[topic].typename
                # empty fits no type, and is counted as damage there
                messages[topic] = [
                    ros1_as_cdr(store, typename, data) or b"" for data in messages[topic]
                ]
        joined = {t: np.concatenate([np.empty(0, HEAD), *parts]) for t, parts in heads.items()}
        return {
            topic: in_log_order(of["log_time"], of["publish_time"], messages[topic])
            for topic, of in joined.items()
        }

    def types(self, topic: str) -> Types:
        """Return a topic's type as the file itself describes it, else as ROS 2 Jazzy does."""
        channel = self._channel(topic)
        if channel.message_encoding == _ROS1:
            return self._ros1_store(topic).fielddefs
        schema = self._map.schemas.get(channel.schema_id)
        if channel.message_encoding != "cdr" or schema is None:
            raise InputError(
                f"'{self.path}': topic {topic} has messages in '{channel.message_encoding}'; "
                "accepted: 'cdr' with a schema, 'ros1'"
            )
        if schema.encoding == "ros2msg":
            return parse_schema(schema.name, schema.data.decode("utf-8", "replace"))
        return super().types(topic)

    def _channel(self, topic: str) -> Channel:
        return self._map.channels[self._numbers[topic][0]]

    def _ros1_store(self, topic: str) -> Typestore:
        schema = self._map.schemas.get(self._channel(topic).schema_id)
        text = schema.data.decode("utf-8", "replace") if schema else ""
        return ros1_store(self.topics[topic].typename, text)

    def _streams(self) -> dict[str, TopicSummary]:
        extents: dict[int, list[tuple[int, int, int]]] = {}
        for place in self._map.chunks:
            for number, rows in (place.index or {}).items():
                if len(rows):
                    extent = len(rows), int(rows[:, 0].min()), int(rows[:, 0].max())
                    extents.setdefault(number, []).append(extent)
        table: dict[str, TopicSummary] = {}
        for name, numbers in sorted(self._numbers.items()):
            channel = self._map.channels[numbers[0]]
            schema = self._map.schemas.get(channel.schema_id)
            typename = schema.name if schema else ""
            if channel.message_encoding == _ROS1 and typename.count("/") == 1:
                typename = typename.replace("/", "/msg/")
            parts = (extent for number in numbers for extent in extents.get(number, ()))
            table[name] = TopicSummary.of(typename, parts)
        return table

    def _pieces(
        self, channels: tuple[int, ...]
    ) -> Iterator[tuple[int, NDArray[np.void], list[bytes]]]:
        for place in self._map.chunks:
            wanted = [number for number in channels if number in (place.index or {})]
            data = self._open(place) if wanted else b""
            for number in wanted:
                rows = (place.index or {}).get(number)
                if rows is None:
                    continue
                piece = extract_messages(data, number, rows[:, 1])
                if piece is None:
                    place.index = index_chunk(data, self._map)
                    piece = extract_messages(data, number, place.index.get(number, rows[:0])[:, 1])
                if piece is not None:
                    yield number, *piece

    def _open(self, place: ChunkPlace) -> bytes | memoryview:
        try:
            return open_chunk(place)
        except ValueError as error:
            place.index = {}
            if str(error) not in self.damage:
                self.damage.append(str(error))
            return b""


def _contents(path: Path) -> memoryview:
    """Read or map a file and check that it is an MCAP file.

    Raises:
        InputError: it can't be read, or begins like no MCAP file.
    """
    try:
        with path.open("rb") as file:
            large = path.stat().st_size > _MAPPED_FROM
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if large else file.read()
    except OSError as error:
        raise InputError(f"can't read '{path}': {error.strerror}") from error
    start = data[: len(MAGIC)]
    if not start or start != MAGIC[: len(start)]:
        raise InputError(f"'{path}' starts with bytes {start.hex(' ')}; accepted: an MCAP file")
    return memoryview(data)

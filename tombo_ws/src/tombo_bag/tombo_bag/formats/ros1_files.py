"""Bags of ROS 1 (`.bag`), read by `rosbags`.

Its reader takes whole files alone. Where it fails, the bag is indexed again up to the damage.
"""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag1.reader import Header, IndexData, ReaderError, RecordType

from tombo_bag.formats.bag_files import BagFile, RawMessages, TopicSummary, by_topic
from tombo_bag.formats.unpacking import unpack
from tombo_bag.schemas import Types, ros1_as_cdr, ros1_store
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

ROS1_MAGIC = b"#ROSBAG V2.0\n"


class Ros1Reader(rosbag1.Reader):
    """A ROS 1 `.bag` (or `.bag.active`) file, also without its index."""

    def close(self) -> None:
        """Close the file."""
        if self.bio is not None:
            super().close()

    def read_chunk(self) -> rosbag1.Chunk:
        """Read the header of a chunk, of which a part can be unpacked, too."""
        assert self.bio is not None
        place = self.bio.tell()
        header = Header.read(self.bio)
        self.bio.seek(place)
        how, size = header.get_string("compression"), header.get_uint32("size")
        return super().read_chunk()._replace(decompressor=lambda data: unpack(how, data, size))

    def mend(self) -> list[str]:
        """Index all messages that are whole; return the losses, a line each.

        Raises:
            ReaderError: the bag is encrypted, or its header is damaged.
        """
        self.close()
        self.bio = file = self.path.open("rb")
        file.seek(len(ROS1_MAGIC))
        head = Header.read(file, RecordType.BAGHEADER)
        if head.get("encryptor"):
            raise ReaderError(f"the bag is encrypted ({head.get_string('encryptor')})")
        never = "the bag was never closed; what was written is read"
        damage = [] if head.get_uint64("index_pos") else [never]
        indexes: dict[int, list[IndexData]] = defaultdict(list)
        end = file.seek(rosbag1.read_uint32(file), os.SEEK_CUR)
        size = self.path.stat().st_size
        while (place := end) < size:
            file.seek(place)
            end = size + 1  # unless the record says it
            try:
                if Header.read(file).get_uint8("op") != RecordType.CHUNK:
                    end = file.seek(rosbag1.read_uint32(file), os.SEEK_CUR)
                    continue
                file.seek(place)
                chunk = self.read_chunk()
                end = file.tell()
                there = min(end, size) - chunk.datapos
                self.chunks[place] = chunk._replace(datasize=there)
                self._index_chunk(place, indexes)
            except (ReaderError, ValueError) as error:
                damage.append(f"record at byte {place} is corrupt: {error}")
        if end > size:
            damage.append("the file is cut off; the records before it are read")
        self.indexes = {c.id: sorted(indexes[c.id]) for c in self.connections}
        return damage

    def _index_chunk(self, place: int, indexes: dict[int, list[IndexData]]) -> None:
        """Note connections and whole messages of a chunk."""
        assert self.bio is not None
        file, chunk = self.bio, self.chunks[place]
        file.seek(chunk.datapos)
        body = chunk.decompressor(file.read(chunk.datasize))
        self.bio = BytesIO(body)  # for `read_connection`
        try:
            while (at := self.bio.tell()) < len(body):
                header = Header.read(self.bio)
                if header.get_uint8("op") == RecordType.CONNECTION:
                    self.bio.seek(at)
                    connection = self.read_connection()
                    if all(known.id != connection.id for known in self.connections):
                        self.connections.append(connection)
                else:
                    rosbag1.read_bytes(self.bio, rosbag1.read_uint32(self.bio))
                    entry = IndexData(header.get_time("time"), place, at)
                    indexes[header.get_uint32("conn")].append(entry)
        finally:
            self.bio = file


class Ros1File(BagFile):
    """A `.bag` file, opened. Types have the form of ROS 2 where that has one."""

    def __init__(self, path: Path) -> None:
        """Find out what is in a file.

        Raises:
            InputError: nothing of it can be read.
        """
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.damage: list[str] = []
        self._reader = Ros1Reader(path)
        try:
            try:
                self._reader.open()
            except Exception:  # on damaged bytes the reader fails in many ways
                self.damage += self._reader.mend()
            self.topics = self._topics()
        except Exception as error:
            self.close()
            accepted = "a ROS 1 bag of format 2.0"
            raise InputError(f"'{path}': {error}; accepted: {accepted}") from error

    def close(self) -> None:
        """Close the reader."""
        self._reader.close()

    def _topics(self) -> dict[str, TopicSummary]:
        """Return type, count and times of each topic, over all of its connections."""
        parts: dict[str, list[tuple[int, int, int]]] = {}
        typenames: dict[str, str] = {}
        for connection in self._reader.connections:
            typenames.setdefault(connection.topic, connection.msgtype)
            there = parts.setdefault(connection.topic, [])
            if entries := self._reader.indexes.get(connection.id):
                there.append((len(entries), entries[0].time, entries[-1].time))
        return {name: TopicSummary.of(typenames[name], of) for name, of in parts.items()}

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics."""
        here = [topic for topic in topics if topic in self.topics]
        try:
            return self._messages(here)
        except InputError:
            raise
        except Exception:  # on damaged bytes the reader fails in many ways
            self.damage += self._reader.mend()
            return self._messages(here)

    def _messages(self, topics: list[str]) -> dict[str, RawMessages]:
        """Read the messages of topics; note as damage the ones that do not fit their type."""
        lost: Counter[str] = Counter()
        connections = [c for c in self._reader.connections if c.topic in topics]

        def rows() -> Iterator[tuple[str, int, bytes]]:
            """Yield topic, time of recording [ns] and message as ROS 2 writes it (CDR)."""
            for connection, time_ns, data in self._reader.messages(connections):
                topic = connection.topic
                message = ros1_as_cdr(self._store(topic), connection.msgtype, data)
                lost[topic] += message is None
                if message is not None:
                    yield topic, time_ns, message

        read = by_topic(topics, rows() if connections else ())
        for topic, count in (+lost).items():
            self.damage.append(f"{count} rows of topic {topic} are no messages of its type")
        return read

    def types(self, topic: str) -> Types:
        """Return a topic's type as ROS 2 Jazzy has it, else as the file describes it."""
        return self._store(topic).fielddefs

    def _store(self, topic: str) -> Typestore:
        """Return the types of ROS 2, with the definition of a topic in a bag of ROS 1.

        Raises:
            InputError: the type is not known, nor is its definition in the file.
        """
        texts = [c.msgdef.data for c in self._reader.connections if c.topic == topic]
        text = next((text for text in texts if text.strip()), "")
        if not text:
            super().types(topic)
        return ros1_store(self.topics[topic].typename, text)

"""Recordings that `rosbags` reads: SQLite files of rosbag2 (`.db3`) and bags of ROS 1 (`.bag`).

Its readers take whole files alone. Where one fails, what stands before the damage is put in order
for it: the rows of an SQLite file are copied into a new one, a bag of ROS 1 is indexed again.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections import Counter, defaultdict
from collections.abc import Collection
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from urllib.parse import quote

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag1.reader import Header, IndexData, ReaderError, RecordType
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from tombo_bag.formats.bag_files import BagFile, RawMessages, TopicSummary, in_log_order
from tombo_bag.formats.unpacking import Allowance, unpack
from tombo_bag.schemas import Types, parse_schema, ros1_as_cdr, ros1_store
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

SQLITE_MAGIC = b"SQLite format 3\0"
ROS1_MAGIC = b"#ROSBAG V2.0\n"
_TABLES = ("schema", "metadata", "topics", "message_definitions", "messages")
Extent: TypeAlias = tuple[int, int, int]
"""Number of messages, first and last log time [ns]."""


class SqliteReader(Sqlite3Reader):
    """A `.db3` file, with the write-ahead log that a killed recorder leaves."""

    accepted = "an SQLite file with rosbag2's tables"

    def __init__(self, path: Path) -> None:
        """Take a path; the reader makes a URI of it."""
        super().__init__(Path(quote(str(path.resolve()))))
        self._recorded = path
        self._log = path.with_name(f"{path.name}-wal")
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def open(self) -> None:
        """Open the file."""
        if self._folder is None and self._log.exists():
            raise ReaderError("the reader passes over a write-ahead log")
        super().open()

    def close(self) -> None:
        """Close the file; remove the copy that was made of it."""
        if self.dbconn is not None:
            super().close()
        if self._folder is not None:
            self._folder.cleanup()

    def mend(self) -> list[str]:
        """Copy the rows before the damage into a new file, and open that; return the losses."""
        self.close()
        self._folder = tempfile.TemporaryDirectory(prefix="tombo-")
        copy = Path(self._folder.name) / "copy.db3"
        shutil.copyfile(self._recorded, copy)
        damage = []
        if missing := _missing_bytes(copy):
            damage.append(f"the file is cut off: its last {missing} bytes are missing")
            os.truncate(copy, copy.stat().st_size + missing)
        if self._log.exists():
            shutil.copyfile(self._log, f"{copy}-wal")
        self.path = copy.with_name("mended.db3")
        with closing(sqlite3.connect(copy)) as old, closing(sqlite3.connect(self.path)) as new:
            for table in _TABLES:
                damage += _copied(old, new, table)
            new.commit()
        self.open()
        return damage

    def extents(self) -> dict[int, Extent]:
        """Return number of a topic → its messages."""
        columns = "topic_id, count(*), min(timestamp), max(timestamp)"
        assert self.dbconn is not None
        rows: Any = self.dbconn.execute(f"SELECT {columns} FROM messages GROUP BY topic_id")
        return {number: (count, first, last) for number, count, first, last in rows}


def _copied(old: sqlite3.Connection, new: sqlite3.Connection, table: str) -> list[str]:
    """Copy a table up to its damage; return the losses."""
    query = "SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ?"
    made = old.execute(query, (table,)).fetchone()
    if made is None:
        return []
    new.execute(made[0])
    width = len(new.execute(f"PRAGMA table_info({table})").fetchall())
    before = new.total_changes
    try:
        rows = old.execute(f"SELECT * FROM {table}")
        new.executemany(f"INSERT INTO {table} VALUES ({', '.join('?' * width)})", rows)
    except (sqlite3.Error, UnicodeDecodeError) as error:
        return [f"{error}; the first {new.total_changes - before} {table} are read"]
    return []


def _missing_bytes(path: Path) -> int:
    """Return how many bytes a file lacks of the size that its head announces (SQLite 1.3)."""
    with path.open("rb") as file:
        head = file.read(100)
    page = int.from_bytes(head[16:18], "big")
    announced = (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")
    return max(announced - path.stat().st_size, 0)


class Ros1Reader(rosbag1.Reader):
    """A ROS 1 `.bag` (or `.bag.active`) file, also without its index."""

    accepted = "a ROS 1 bag of format 2.0"

    def close(self) -> None:
        """Close the file."""
        if self.bio is not None:
            super().close()

    def read_chunk(self) -> rosbag1.Chunk:
        """Read the header of a chunk, which is not unpacked to more than it states."""
        assert self.bio is not None
        place = self.bio.tell()
        header = Header.read(self.bio)
        self.bio.seek(place)
        how, stated = header.get_string("compression"), header.get_uint32("size")
        size = min(stated, Allowance(Path(str(self.path)), self.path.stat().st_size).left)
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

    def extents(self) -> dict[int, Extent]:
        """Return number of a connection → its messages."""
        return {
            number: (len(of), of[0].time, of[-1].time) for number, of in self.indexes.items() if of
        }


class RosbagsFile(BagFile):
    """A file that one of these readers has opened."""

    def __init__(self, path: Path, kind: type[SqliteReader] | type[Ros1Reader]) -> None:
        """Find out what is in a file.

        Raises:
            InputError: nothing of it can be read.
        """
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.damage: list[str] = []
        self._reader = kind(path)
        try:
            try:
                self._reader.open()
                self.topics = self._topics()
            except Exception:  # on damaged bytes the readers fail in many ways
                self.damage += self._reader.mend()
                self.topics = self._topics()
        except Exception as error:
            self.close()
            raise InputError(f"'{path}': {error}; accepted: {kind.accepted}") from error

    def close(self) -> None:
        """Close the reader."""
        self._reader.close()

    def _topics(self) -> dict[str, TopicSummary]:
        extents = self._reader.extents()
        parts: dict[str, list[Extent]] = {}
        typenames: dict[str, str] = {}
        for connection in self._reader.connections:
            name = connection.topic
            encoding = getattr(connection.ext, "serialization_format", "cdr")
            if encoding != "cdr":
                self.damage.append(f"topic {name} has messages in '{encoding}', not 'cdr'")
                continue
            typenames.setdefault(name, connection.msgtype)
            there = parts.setdefault(name, [])
            if connection.id in extents:
                there.append(extents[connection.id])
        return {name: TopicSummary.of(typenames[name], of) for name, of in parts.items()}

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics."""
        here = [topic for topic in topics if topic in self.topics]
        try:
            return self._messages(here)
        except InputError:
            raise
        except Exception:  # on damaged bytes the readers fail in many ways
            self.damage += self._reader.mend()
            return self._messages(here)

    def _messages(self, topics: list[str]) -> dict[str, RawMessages]:
        times: dict[str, list[int]] = {topic: [] for topic in topics}
        messages: dict[str, list[bytes]] = {topic: [] for topic in topics}
        lost: Counter[str] = Counter()
        allowance = Allowance(self.path)
        connections = [c for c in self._reader.connections if c.topic in times]
        for connection, time, data in self._reader.messages(connections) if connections else ():
            message = self._as_cdr(connection, data)
            if message is None:
                lost[connection.topic] += 1
                continue
            allowance.take(len(message))
            times[connection.topic].append(time)
            messages[connection.topic].append(message)
        for topic, count in lost.items():
            self.damage.append(f"{count} rows of topic {topic} are no messages of its type")
        return {t: in_log_order(times[t], times[t], messages[t]) for t in topics}

    def _as_cdr(self, connection: Connection, data: bytes) -> bytes | None:
        if isinstance(self._reader, SqliteReader):
            return data
        return ros1_as_cdr(self._store(connection.topic), connection.msgtype, data)

    def types(self, topic: str) -> Types:
        """Return a topic's type as the file describes it, else as ROS 2 Jazzy does.

        A type of ROS 1 has the form of ROS 2 where that has one.
        """
        text = self._definition(topic)
        if isinstance(self._reader, Ros1Reader):
            return self._store(topic).fielddefs
        return parse_schema(self.topics[topic].typename, text) if text else super().types(topic)

    def _store(self, topic: str) -> Typestore:
        """Return the types of ROS 2, with the definition of a topic in a bag of ROS 1.

        Raises:
            InputError: the type is not known, nor is its definition in the file.
        """
        typename, text = self.topics[topic].typename, self._definition(topic)
        if not text:
            super().types(topic)
        return ros1_store(typename, text)

    def _definition(self, topic: str) -> str:
        definitions = [c.msgdef for c in self._reader.connections if c.topic == topic]
        texts = [d.data for d in definitions if d.format == MessageDefinitionFormat.MSG]
        return next((text for text in texts if text.strip()), "")

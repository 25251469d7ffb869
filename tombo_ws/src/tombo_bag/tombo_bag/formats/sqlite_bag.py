"""An SQLite file of rosbag2 (`.db3`); of a damaged one, every row up to the damage."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
import time
from collections.abc import Collection, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tombo_bag.formats.bag_files import LATEST_NS, BagFile, RawMessages, TopicSummary, in_log_order
from tombo_bag.formats.unpacking import Allowance, memory_limit
from tombo_bag.schemas import Types, parse_schema
from tombo_dynamics.errors import InputError

_LARGEST = 1 << 36
MAGIC = b"SQLite format 3\0"
_TYPED = "typeof(timestamp) = 'integer' AND typeof(data) = 'blob' AND timestamp BETWEEN 0 AND " + (
    str(LATEST_NS - 1)
)
"""Rows that are messages; SQLite takes any value in any column."""
_ERRORS = (sqlite3.Error, UnicodeDecodeError)
"""What SQLite raises; the second where its own message quotes a damaged file."""
_LARGEST_VALUE = 1 << 30
_MOST_TOPICS = 20_000
_ROW = 4
"""Bytes that a row takes in a file at least."""
_PATIENCE_S, _SLOWEST = 4.0, 2e7
"""A query may take so long, and a second for so many bytes of the file."""
_NOTE = 500
_STEPS = 20_000
"""Of SQLite's machine, after which it is asked whether to go on."""


class SqliteBag(BagFile):
    """A `.db3` file, with the write-ahead log that a killed recorder leaves beside it."""

    def __init__(self, path: Path) -> None:
        """Find out what is in a file.

        Raises:
            InputError: it is no SQLite file, or none of rosbag2.
        """
        self.path = path
        self.damage: list[str] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.topics: dict[str, TopicSummary] = {}
        self._numbers: dict[str, list[int]] = {}
        self._definitions: dict[str, str] = {}
        self._padded: tempfile.TemporaryDirectory[str] | None = None
        self._connection, rows = self._topics()
        self._size = path.stat().st_size + _beside(path)
        self._read_definitions()
        try:
            extents, unknown = self._extents(), (0, 0, 0)
        except _ERRORS as error:
            self._note(f"{error}; what can be read before that is read")
            extents, unknown = {}, (1, 0, 0)
        first_of = {row[0]: row for row in reversed(rows)}
        for number, name, typename, encoding in reversed(first_of.values()):
            if encoding != "cdr":
                self._note(f"topic {name} has messages in '{encoding[:40]}', not 'cdr'")
                continue
            self._numbers.setdefault(name, []).append(number)
            self.topics[name] = TopicSummary(typename, *extents.get(number, unknown))

    def close(self) -> None:
        """Close the database."""
        self._connection.close()
        if self._padded is not None:
            self._padded.cleanup()

    def _topics(self) -> tuple[sqlite3.Connection, list[tuple[Any, ...]]]:
        """Open the file and read its table of topics; a file that is cut off is padded for it."""
        try:
            return _opened(self.path)
        except _ERRORS as error:
            refused = InputError(
                f"'{self.path}': {error}; accepted: an SQLite file with rosbag2's tables"
            )
            missing = _missing_bytes(self.path)
            if not missing:
                raise refused from error
        self._padded = tempfile.TemporaryDirectory(prefix="tombo-")
        copy = Path(self._padded.name) / self.path.name
        shutil.copyfile(self.path, copy)
        os.truncate(copy, copy.stat().st_size + missing)
        self.damage.append(f"the file is cut off: its last {missing} bytes are missing")
        try:
            return _opened(copy)
        except _ERRORS as error:
            raise refused from error

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics."""
        by_topic: dict[str, RawMessages] = {}
        for topic in (name for name in topics if name in self.topics):
            times: list[int] = []
            messages: list[bytes] = []
            query = f"SELECT timestamp, data FROM messages WHERE topic_id = ? AND {_TYPED}"
            allowance = Allowance(self.path, min(memory_limit(), self._size))
            try:
                for number in self._numbers[topic]:
                    with closing(self._run(query, number)) as rows:
                        for stamp, data in rows:
                            allowance.take(len(data) + _ROW)
                            times.append(stamp)
                            messages.append(data)
            except (*_ERRORS, InputError) as error:
                self._note(
                    f"{error}; of topic {topic} the first {len(messages)} messages are read"
                )
            by_topic[topic] = in_log_order(times, times, messages)
        return by_topic

    def types(self, topic: str) -> Types:
        """Return a topic's type as the file describes it, else as ROS 2 Jazzy does."""
        typename = self.topics[topic].typename
        if typename in self._definitions:
            return parse_schema(typename, self._definitions[typename])
        return super().types(topic)

    def _extents(self) -> dict[int, tuple[int, int, int]]:
        """Return number of a topic → its messages, first and last log time [ns].

        Raises:
            sqlite3.Error: the table is damaged.
        """
        query = (
            "SELECT topic_id, sum(good), sum(1 - good), min(iif(good, timestamp, NULL)), "
            "max(iif(good, timestamp, NULL)) FROM (SELECT topic_id, timestamp, "
            f"{_TYPED} AS good FROM messages) GROUP BY topic_id"
        )
        extents: dict[int, tuple[int, int, int]] = {}
        lost = 0
        for number, count, rejected, first, last in self._run(query):
            extents[number] = count, first or 0, last or 0
            lost += rejected
        if lost:
            self._note(f"{lost} rows are no messages: time or data of another type; left out")
        return extents

    def _read_definitions(self) -> None:
        """Read the definitions that Iron and later put beside the messages; others have none."""
        columns = ("topic_type", "encoding", "encoded_message_definition")
        query = f"SELECT {', '.join(columns)} FROM message_definitions"
        try:
            _check_table(self._connection, "message_definitions", columns)
            for typename, encoding, text in self._run(query):
                if encoding == "ros2msg" and isinstance(typename, str) and isinstance(text, str):
                    self._definitions[typename] = text
        except _ERRORS:
            return

    def _run(self, query: str, *values: int) -> sqlite3.Cursor:
        """Run a query that may take as long as its file is large."""
        end = time.monotonic() + _PATIENCE_S + self._size / _SLOWEST
        self._connection.set_progress_handler(lambda: time.monotonic() > end, _STEPS)
        return self._connection.execute(query, values)

    def _note(self, text: str) -> None:
        if text[:_NOTE] not in self.damage:
            self.damage.append(text[:_NOTE])


def _opened(path: Path) -> tuple[sqlite3.Connection, list[tuple[Any, ...]]]:
    """Open a file for reading, with its write-ahead log if the folder allows; also: its topics.

    Raises:
        sqlite3.Error: it is none of rosbag2, or damaged where the topics stand.
    """
    if path.with_name(path.name + "-wal").exists():
        with suppress(*_ERRORS):
            return _connected(path, "mode=ro")
    return _connected(path, "immutable=1")


def _connected(path: Path, mode: str) -> tuple[sqlite3.Connection, list[tuple[Any, ...]]]:
    connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?{mode}", uri=True)
    columns = ("id", "name", "type", "serialization_format")
    try:
        end = time.monotonic() + _PATIENCE_S
        connection.set_progress_handler(lambda: time.monotonic() > end, _STEPS)
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LARGEST_VALUE)
        _check_table(connection, "topics", columns)
        _check_table(connection, "messages", ("topic_id", "timestamp", "data"))
        rows = connection.execute(f"SELECT {', '.join(columns)} FROM topics LIMIT {_MOST_TOPICS}")
        return connection, [row for row in rows if tuple(map(type, row)) == (int, str, str, str)]
    except _ERRORS:
        connection.close()
        raise


def _check_table(connection: sqlite3.Connection, name: str, columns: Sequence[str]) -> None:
    """Refuse what computes its rows: a view, a virtual table, a generated column.

    Raises:
        sqlite3.Error: it is no plain table with these columns.
    """
    query = "SELECT type, rootpage FROM sqlite_master WHERE name = ?"
    rows = connection.execute(query, (name,)).fetchall()
    if len(rows) != 1 or rows[0][0] != "table" or not rows[0][1]:
        raise sqlite3.DatabaseError(f"no such table: {name}")
    there = {row[1]: row[6] for row in connection.execute(f"PRAGMA table_xinfo({name})")}
    for column in columns:
        if there.get(column) != 0:
            raise sqlite3.DatabaseError(f"no such column: {name}.{column}")


def _beside(path: Path) -> int:
    """Return the size of the write-ahead log [bytes]."""
    with suppress(OSError):
        return path.with_name(path.name + "-wal").stat().st_size
    return 0


def _missing_bytes(path: Path) -> int:
    """Return how many bytes a file lacks of the size that its head announces (SQLite 1.3)."""
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100:
        return 0
    page = int.from_bytes(head[16:18], "big")
    announced = (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")
    return min(max(announced - path.stat().st_size, 0), _LARGEST)

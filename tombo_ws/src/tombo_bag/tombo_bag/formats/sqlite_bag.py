"""An SQLite file of rosbag2 (`.db3`); of a damaged one, every row up to the damage."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Collection
from contextlib import closing, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tombo_bag.formats.bag_files import BagFile, RawMessages, Stream, in_log_order
from tombo_bag.schemas import Types, parse_schema
from tombo_dynamics.errors import InputError

_LARGEST = 1 << 36
MAGIC = b"SQLite format 3\0"


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
        self.topics: dict[str, Stream] = {}
        self._numbers: dict[str, list[int]] = {}
        self._definitions: dict[str, str] = {}
        self._padded: tempfile.TemporaryDirectory[str] | None = None
        self._connection, rows = self._topics()
        self._read_definitions()
        for number, name, typename, encoding in rows:
            if encoding != "cdr":
                self.damage.append(f"topic {name} has messages in '{encoding}', not 'cdr'")
                continue
            self._numbers.setdefault(str(name), []).append(int(number))
            self.topics[str(name)] = Stream(str(typename), *self._extent(int(number)))

    def close(self) -> None:
        """Close the database."""
        self._connection.close()
        if self._padded is not None:
            self._padded.cleanup()

    def _topics(self) -> tuple[sqlite3.Connection, list[tuple[Any, ...]]]:
        """Open the file and read its table of topics; a file that is cut off is padded for it."""
        try:
            return _opened(self.path)
        except sqlite3.Error as error:
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
        except sqlite3.Error as error:
            raise refused from error

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics."""
        found: dict[str, RawMessages] = {}
        for topic in (name for name in topics if name in self.topics):
            times: list[int] = []
            messages: list[bytes] = []
            marks = ", ".join("?" * len(self._numbers[topic]))
            query = f"SELECT timestamp, data FROM messages WHERE topic_id IN ({marks})"
            try:
                with closing(self._connection.execute(query, self._numbers[topic])) as rows:
                    for time, data in rows:
                        times.append(int(time))
                        messages.append(bytes(data))
            except (sqlite3.Error, TypeError, ValueError) as error:
                self._note(
                    f"{error}; of topic {topic} the first {len(messages)} messages are read"
                )
            found[topic] = in_log_order(times, times, messages)
        return found

    def types(self, topic: str) -> Types:
        """Return a topic's type as the file describes it, else as ROS 2 Jazzy does."""
        typename = self.topics[topic].typename
        if typename in self._definitions:
            return parse_schema(typename, self._definitions[typename])
        return super().types(topic)

    def _extent(self, number: int) -> tuple[int, int, int]:
        """Return number of messages, first and last log time [ns] of a topic."""
        query = "SELECT count(*), min(timestamp), max(timestamp) FROM messages WHERE topic_id = ?"
        try:
            row: tuple[Any, ...] = self._connection.execute(query, (number,)).fetchone()
        except sqlite3.Error as error:
            self._note(f"{error}; what can be read before that is read")
            return 1, 0, 0
        return int(row[0]), int(row[1] or 0), int(row[2] or 0)

    def _read_definitions(self) -> None:
        """Read the definitions that Iron and later put beside the messages; others have none."""
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        try:
            for typename, encoding, text in self._connection.execute(query):
                if encoding == "ros2msg" and text:
                    self._definitions[str(typename)] = str(text)
        except sqlite3.Error:
            return

    def _note(self, text: str) -> None:
        if text not in self.damage:
            self.damage.append(text)


def _opened(path: Path) -> tuple[sqlite3.Connection, list[tuple[Any, ...]]]:
    """Open a file for reading, with its write-ahead log if the folder allows; also: its topics.

    Raises:
        sqlite3.Error: it is none of rosbag2, or damaged where the topics stand.
    """
    if path.with_name(path.name + "-wal").exists():
        with suppress(sqlite3.Error):
            return _connected(path, "mode=ro")
    return _connected(path, "immutable=1")


def _connected(path: Path, mode: str) -> tuple[sqlite3.Connection, list[tuple[Any, ...]]]:
    connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?{mode}", uri=True)
    try:
        query = "SELECT id, name, type, serialization_format FROM topics"
        return connection, connection.execute(query).fetchall()
    except sqlite3.Error:
        connection.close()
        raise


def _missing_bytes(path: Path) -> int:
    """Return how many bytes a file lacks of the size that its head announces (SQLite 1.3)."""
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100:
        return 0
    page = int.from_bytes(head[16:18], "big")
    announced = (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")
    return min(max(announced - path.stat().st_size, 0), _LARGEST)

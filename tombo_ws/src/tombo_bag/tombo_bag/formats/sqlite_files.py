"""SQLite files of rosbag2 (`.db3`)."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tombo_bag.formats.bag_files import BagFile, RawMessages, TopicSummary, by_topic
from tombo_bag.schemas import Types, parse_schema
from tombo_dynamics.errors import InputError

SQLITE_MAGIC = b"SQLite format 3\0"


class SqliteFile(BagFile):
    """A `.db3` file, with the write-ahead log that a killed recorder leaves.

    Tables are read without their indexes, so a damaged file gives the rows before the damage.
    """

    def __init__(self, path: Path) -> None:
        """Find out what is in a file.

        Raises:
            InputError: it has no topics of rosbag2.
        """
        self.path, self.metadata = path, {}
        self.damage: list[str] = []
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._database = self._open()
        try:
            self.topics = self._topics()
        except sqlite3.Error as error:
            self.close()
            accepted = "an SQLite file with rosbag2's tables"
            raise InputError(f"'{path}': {error}; accepted: {accepted}") from error

    def close(self) -> None:
        """Close the database; remove the copy that was made of it."""
        self._database.close()
        if self._folder is not None:
            self._folder.cleanup()

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics."""
        here = {number: name for number, name in self._names.items() if name in topics}
        wanted = f"topic_id IN ({', '.join(map(str, here))})"
        rows = self._rows("topic_id, timestamp, data", wanted)
        named = ((here[number], time, data) for number, time, data in rows)
        return by_topic(here.values(), named)

    def types(self, topic: str) -> Types:
        """Return a topic's type as the file describes it, else as ROS 2 Jazzy does."""
        typename = self.topics[topic].typename
        text = self._definitions.get(typename, "")
        return parse_schema(typename, text) if text.strip() else super().types(topic)

    def _open(self) -> sqlite3.Connection:
        """Open the file, or a copy of its whole pages if it is cut off or has a log."""
        path, how = self.path.resolve(), "mode=ro&immutable=1"
        log = path.with_name(f"{path.name}-wal")
        page, announced = _page_and_size(path)
        size = path.stat().st_size
        if size < announced:
            lost = f"the file is cut off: its last {announced - size} bytes are missing"
            self.damage.append(lost)
        if log.exists() or size < announced:
            self._folder = tempfile.TemporaryDirectory(prefix="tombo-")
            copy = Path(self._folder.name) / "copy.db3"
            shutil.copyfile(path, copy)
            os.truncate(copy, size - size % page)
            if log.exists():
                shutil.copyfile(log, f"{copy}-wal")
            path, how = copy, "mode=rw"
        database = sqlite3.connect(f"file:{quote(str(path))}?{how}", uri=True)
        database.execute("PRAGMA writable_schema = ON")  # else a file that is cut does not open
        return database

    def _topics(self) -> dict[str, TopicSummary]:
        """Note the topics' names and definitions; return their summaries."""
        columns = "id, name, type, serialization_format"
        rows = self._database.execute(f"SELECT {columns} FROM topics").fetchall()
        for _, name, _, encoding in rows:
            if encoding != "cdr":
                self.damage.append(f"topic {name} has messages in '{encoding}', not 'cdr'")
        typenames = {name: typename for _, name, typename, how in rows if how == "cdr"}
        self._names = {number: name for number, name, _, how in rows if how == "cdr"}
        self._definitions = dict(self._described())
        times: dict[str, list[int]] = {name: [] for name in typenames}
        for number, time in self._rows("topic_id, timestamp"):
            if number in self._names:
                times[self._names[number]].append(time)
        return {
            name: TopicSummary(typenames[name], len(of), min(of, default=0), max(of, default=0))
            for name, of in times.items()
        }

    def _described(self) -> Iterator[tuple[str, str]]:
        """Yield type and definition; a file older than ROS 2 Iron has none."""
        columns = "topic_type, encoded_message_definition"
        query = f"SELECT {columns} FROM message_definitions WHERE encoding = 'ros2msg'"
        try:
            yield from self._database.execute(query)
        except sqlite3.Error:
            return

    def _rows(self, columns: str, which: str = "TRUE") -> Iterator[Any]:
        """Yield the rows of the messages up to a damage, which is noted."""
        count = 0
        try:
            for row in self._database.execute(f"SELECT {columns} FROM messages WHERE {which}"):
                count += 1
                yield row
        except sqlite3.Error as error:
            note = f"{error}; rows after the first {count} are lost"
            if not any(line.startswith(str(error)) for line in self.damage):
                self.damage.append(note)


def _page_and_size(path: Path) -> tuple[int, int]:
    """Return the sizes of a page and of the file [bytes] that its head announces (SQLite 1.3)."""
    with path.open("rb") as file:
        head = file.read(100)
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page <= 1 else page
    return page, page * int.from_bytes(head[28:32], "big")

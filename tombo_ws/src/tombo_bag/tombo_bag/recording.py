"""Any recorded run: one file or a folder of them, MCAP, SQLite or ROS 1, as columns by topic.

What kind a file is, its first bytes say, not its name. A folder is read by its `metadata.yaml`, or
without one (a recorder that was killed writes none) whole. Topics can be given the suite's names.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable, TopicColumns, columns_of
from tombo_bag.formats.bag_files import (
    READABLE,
    BagFile,
    RawMessages,
    TopicSummary,
    in_log_order,
    plain,
)
from tombo_bag.formats.chunks import MAGIC
from tombo_bag.formats.reader import Bag
from tombo_bag.formats.ros1_files import ROS1_MAGIC, Ros1File
from tombo_bag.formats.sqlite_files import SQLITE_MAGIC, SqliteFile
from tombo_bag.formats.unpacking import ZSTD_MAGIC, unpack_file
from tombo_bag.rigid_bodies import bodies_in
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.yaml_text import read_yaml

SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd", ".bag")
"""Endings of the files of a recording; a folder is searched for them."""


class Recording:
    """A recorded run, opened. Use as a context manager: unpacked files are removed at the end."""

    def __init__(self, path: str | Path, names: Mapping[str, str] | None = None) -> None:
        """Open a file or a folder.

        Args:
            path: file or folder.
            names: topic as recorded → name under which it is read here; it hides a topic that is
                recorded under that name.

        Raises:
            InputError: nothing there, nothing that can be read, or no such topic.
        """
        self.path = Path(path)
        self._notes: list[str] = []
        self._unpacked: tempfile.TemporaryDirectory[str] | None = None
        self._cache: dict[str, RawMessages] = {}
        self._tables: dict[str, ColumnTable] = {}
        self._clock: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
        self.files: list[BagFile] = []
        try:
            self.files.extend(self._open_all())
            if not self.files:
                why = f" ({self._notes[0]})" if self._notes else ""
                raise InputError(f"'{self.path}' holds no recording{why}; accepted: {READABLE}")
            self.files.extend(self._bodies())
            self._recorded_name = self._rename(names or {})
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Recording:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Close the files and remove what was unpacked."""
        for file in self.files:
            file.close()
        if self._unpacked is not None:
            self._unpacked.cleanup()
            self._unpacked = None

    @property
    def damage(self) -> list[str]:
        """Damage found so far, a line each; complete after all topics are read."""
        several = len({file.path for file in self.files}) > 1
        lines = list(self._notes)
        for file in self.files:
            where = f"{file.path.name}: " if several else ""
            lines += [f"{where}{line}" for line in file.damage]
        return list(dict.fromkeys(lines))

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Metadata records, name → texts by key; of several files the first counts."""
        merged: dict[str, dict[str, str]] = {}
        for file in reversed(self.files):
            merged.update({name: dict(values) for name, values in file.metadata.items()})
        return merged

    @property
    def topics(self) -> dict[str, TopicSummary]:
        """The topics by the names under which they are read here, sorted."""
        table: dict[str, TopicSummary] = {}
        for name, recorded in sorted(self._recorded_name.items()):
            streams = [f.topics[recorded] for f in self.files if recorded in f.topics]
            extents = ((s.count, s.first_ns, s.last_ns) for s in streams)
            table[name] = TopicSummary.of(streams[0].typename, extents)
        return table

    def load(self, topics: Collection[str]) -> None:
        """Read the messages of some topics at once, which is quicker than one by one.

        Raises:
            InputError: one of them has a type that can't be read; then none is loaded.
        """
        wanted = [name for name in topics if name in self._recorded_name]
        wanted = [name for name in wanted if name not in self._cache]
        recorded = {self._recorded_name[name]: name for name in wanted}
        parts: dict[str, list[RawMessages]] = {name: [] for name in wanted}
        for file in self.files:
            for topic, raw in file.messages(list(recorded)).items():
                if len(raw.messages):
                    parts[recorded[topic]].append(plain(raw))
        self._cache.update({name: _joined(of) for name, of in parts.items()})

    def set_clock(self, log_ns: NDArray[np.int64], now_ns: NDArray[np.int64]) -> None:
        """Let another clock than the recorder's give the log times of all columns.

        Args:
            log_ns: log times, rising.
            now_ns: reading of the other clock then.
        """
        self._clock = log_ns, now_ns
        self._tables.clear()

    def on_clock(self, log_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return log times as columns have them, by the clock of `set_clock` if there is one."""
        if self._clock is None:
            return log_ns
        before = np.searchsorted(self._clock[0], log_ns, side="right") - 1
        return np.asarray(self._clock[1][np.maximum(before, 0)])

    def messages(self, topic: str) -> RawMessages:
        """Read a topic's messages as CDR, in order of log time.

        Raises:
            InputError: no such topic.
        """
        if topic not in self._recorded_name:
            raise unknown_name(f"topic in '{self.path}'", topic, self._recorded_name)
        self.load([topic])
        return self._cache[topic]

    def columns(self, topic: str) -> ColumnTable:
        """Read a topic as columns, in order of log time; see `columns.columns_of`.

        Of several files the first with messages says their type. Those that don't fit it are left
        out and listed in `damage`.

        Raises:
            InputError: no such topic, or of a type that can't be read.
        """
        if topic not in self._tables:
            self._tables[topic] = TopicColumns(topic, self._table(topic))
        return self._tables[topic]

    def _table(self, topic: str) -> ColumnTable:
        raw = self.messages(topic)
        times = {
            "log_time_ns": self.on_clock(raw.log_times_ns),
            "publish_time_ns": raw.publish_times_ns,
        }
        number, recorded, lost = len(raw.messages), self._recorded_name[topic], list[int]()
        if not number:
            return {**times, "stamp_ns": np.zeros(0, np.int64)}
        file = next(f for f in self.files if recorded in f.topics and f.topics[recorded].count)
        typename, types = file.topics[recorded].typename, file.types(recorded)
        table = columns_of(typename, raw.messages, types, lost)
        if len(lost) == number:
            columns_of(typename, raw.messages[:1], types)  # says why
        if lost:
            self._notes.append(f"{len(lost)} of {number} messages of {topic} don't fit {typename}")
        return {**{key: np.delete(of, lost) for key, of in times.items()}, **table}

    def _rename(self, names: Mapping[str, str]) -> dict[str, str]:
        recorded = {topic for file in self.files for topic in file.topics}
        for source in names:
            if source not in recorded:
                raise unknown_name(f"topic in '{self.path}'", source, recorded)
        if len(set(names.values())) < len(names):
            twice = ", ".join(f"{source}:={name}" for source, name in names.items())
            raise InputError(f"{twice}: two topics under one name; accepted: one for each")
        kept = {topic: topic for topic in recorded if topic not in names}
        return {**kept, **{name: source for source, name in names.items()}}

    def _open_all(self) -> Iterator[BagFile]:
        try:
            is_folder = self.path.is_dir()
            if not is_folder:
                yield self._open(self.path)
                return
            paths = self._files_of_folder()
        except OSError as error:
            raise InputError(f"can't read '{self.path}': {error.strerror}") from error
        for path in paths:
            try:
                yield self._open(path)
            except InputError as error:
                if len(paths) == 1:
                    raise
                self._notes.append(str(error).partition("; accepted")[0])

    def _bodies(self) -> list[BagFile]:
        try:
            return list(bodies_in(self.files))
        except InputError as error:
            self._notes.append(str(error).partition("; accepted")[0])
            return []

    def _files_of_folder(self) -> list[Path]:
        """Return all recordings in the folder; note those of `metadata.yaml` that are missing."""
        there = sorted(p for p in self.path.iterdir() if p.name.endswith(SUFFIXES))
        described = self.path / "metadata.yaml"
        if described.is_file():
            for name in self._listed(described) - {path.name for path in there}:
                self._notes.append(f"{name}, which metadata.yaml names, is missing")
        return there

    def _listed(self, described: Path) -> set[str]:
        """Return the names of files in `metadata.yaml`."""
        try:
            content = read_yaml(described, described.name)
            names = content["rosbag2_bagfile_information"]["relative_file_paths"]
            return {Path(str(name)).name for name in names}
        except (InputError, TypeError, LookupError):
            self._notes.append("metadata.yaml can't be read")
            return set()

    def _open(self, path: Path) -> BagFile:
        start = first_bytes(path, READABLE)
        if start.startswith(ZSTD_MAGIC) and not self._is_unpacked(path):
            return self._open(self._unpack(path))
        for magic, kind in _KINDS.items():
            if start.startswith(magic):
                return kind(path)
        if MAGIC.startswith(start):
            return Bag(path)
        if start.startswith(b"#ROSBAG"):
            version = start[9:12].decode("ascii", "replace")
            raise InputError(f"'{path}' is a ROS 1 bag of version {version}; accepted: 2.0")
        raise InputError(f"'{path}' starts with bytes {start[:8].hex(' ')}; accepted: {READABLE}")

    def _unpack(self, path: Path) -> Path:
        """Unpack a file compressed as a whole; of a cut one, its beginning."""
        if self._unpacked is None:
            self._unpacked = tempfile.TemporaryDirectory(prefix="tombo-")
        target = Path(self._unpacked.name) / path.name.removesuffix(".zstd")
        with path.open("rb") as source, target.open("wb") as out:
            wrong = unpack_file(source, out)
        if wrong:
            self._notes.append(f"{path.name}: {wrong}")
        return target

    def _is_unpacked(self, path: Path) -> bool:
        """Whether a file was unpacked here; none holds another."""
        return self._unpacked is not None and path.parent == Path(self._unpacked.name)


_KINDS: dict[bytes, Callable[[Path], BagFile]] = {
    MAGIC: Bag,
    SQLITE_MAGIC: SqliteFile,
    ROS1_MAGIC: Ros1File,
}


def first_bytes(path: Path, accepted: str) -> bytes:
    """Return the start of a file, which says its kind.

    Raises:
        InputError: it can't be read or is empty; says what is accepted.
    """
    try:
        with path.open("rb") as file:
            start = file.read(64)
    except OSError as error:
        why = f"{error.strerror}; accepted: {accepted}"
        raise InputError(f"can't read '{path}': {why}") from error
    if not start:
        raise InputError(f"'{path}' is empty; accepted: {accepted}")
    return start


def _joined(parts: list[RawMessages]) -> RawMessages:
    """Return the messages of several files in order of log time."""
    if len(parts) == 1:
        return parts[0]
    return in_log_order(
        np.concatenate([np.zeros(0, np.int64), *(raw.log_times_ns for raw in parts)]),
        np.concatenate([np.zeros(0, np.int64), *(raw.publish_times_ns for raw in parts)]),
        [message for raw in parts for message in raw.messages],
    )

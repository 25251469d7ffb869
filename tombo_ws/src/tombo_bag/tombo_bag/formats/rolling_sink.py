"""Writes a recording as it comes: into a rosbag2 folder with one file after the other, or a file.

Messages wait in memory until `flush`, which the recorder calls more than twice a second, and go to
`McapSink` as one chunk, cleaned (see `padding`) and in order of log time.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tombo_bag.formats.bag_metadata import BagMetadata, FileEntry, TopicEntry
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.formats.padding import without_padding
from tombo_bag.qos import Qos
from tombo_bag.schemas import known_types, type_hash
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS

NOTES = "tombo_recorder"
"""Name of the metadata record with what the recorder has to say."""

Waiting: TypeAlias = "list[tuple[int, int, bytes]]"
"""Log time, publish time and bytes of messages that are not written yet."""


@dataclass(frozen=True)
class RollingOptions:
    """Where and how to record.

    Attributes:
        target: folder to make, or with `single_file` the file.
        single_file: one MCAP file, no folder, no `metadata.yaml`.
        file_size_max: a file that has reached this size [bytes] ends; 0: no limit.
        file_duration_max: a file holds less log time than this [s]; 0: no limit.
        compression: `zstd`, `lz4` or `none`.
    """

    target: Path
    single_file: bool = False
    file_size_max: int = 0
    file_duration_max: float = 0.0
    compression: str = "zstd"

    def __post_init__(self) -> None:
        """Check what doesn't depend on the disk.

        Raises:
            InputError: a limit below 0, limits for a single file, or one not called `.mcap`.
        """
        for name in ("file_size_max", "file_duration_max"):
            value = getattr(self, name)
            if not 0 <= value < math.inf or (value and self.single_file):
                accepted = "0 with a single file" if self.single_file else "0 or more"
                raise InputError(f"{name} is {value}; accepted: {accepted}")
        if self.single_file and self.target.suffix != ".mcap":
            raise InputError(f"single_file is '{self.target}'; accepted: a name ending in .mcap")


@dataclass
class _Topic:
    typename: str
    type_hash: str
    qos: Qos
    channel: int
    padded: bool = False
    waiting: Waiting = field(default_factory=list)


class RollingSink:
    """A recording. `close` finishes it, whatever happened before."""

    def __init__(
        self,
        options: RollingOptions,
        notes: Callable[[], Mapping[str, str]] = dict,
        records: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        """Make folder and first file.

        Args:
            options: where and how.
            notes: returns what to write into each file that is finished, as the metadata record
                `tombo_recorder`, and into `metadata.yaml`.
            records: metadata records to begin each file with: name → values.

        Raises:
            InputError: the target is there already or can't be written, or the compression is
                unknown.
        """
        self.options = options
        self._notes = notes
        self._records = {name: dict(values) for name, values in (records or {}).items()}
        self._topics: dict[str, _Topic] = {}
        self._done: list[FileEntry] = []
        self._done_bytes = 0
        self._done_counts: Counter[str] = Counter()
        self._received = 0
        self._first_ns: int | None = None
        target = options.target
        if target.is_symlink() or target.exists():
            raise InputError(f"'{target}' is there already; accepted: a new name")
        try:
            if not options.single_file:
                target.mkdir(parents=True)
        except OSError as error:
            raise InputError(f"can't make folder '{target}': {error.strerror}") from error
        try:
            self._sink = self._open()
        except InputError:
            if not options.single_file:
                target.rmdir()
            raise

    @property
    def path(self) -> Path:
        """The file being written, or the last one."""
        return self._path(len(self._done) - (1 if self._done and self._sink.closed else 0))

    @property
    def size(self) -> int:
        """Bytes written so far, in all files."""
        return self._done_bytes + (0 if self._sink.closed else self._sink.size)

    @property
    def messages(self) -> int:
        """Messages written so far, in all files."""
        now = 0 if self._sink.closed else self._sink.message_counts.total()
        return self._done_counts.total() + now

    @property
    def topics(self) -> list[str]:
        """Names of the topics announced."""
        return list(self._topics)

    @property
    def unwritten(self) -> int:
        """Messages that were taken but could not be written: the disk was full or failed."""
        waiting = sum(len(topic.waiting) for topic in self._topics.values())
        return self._received - self.messages - waiting

    def add_topic(self, name: str, typename: str, qos: Qos) -> None:
        """Announce a topic; once more does nothing.

        Raises:
            InputError: unknown type, or the topic is there with another one.
        """
        known = self._topics.get(name)
        if known is None:
            hashed = type_hash(typename)
            channel = 0 if self._sink.closed else self._sink.add_channel(name, typename, qos)
            self._topics[name] = _Topic(typename, hashed, qos, channel)
        elif known.typename != typename:
            raise InputError(
                f"topic '{name}' has type {typename}; it is {known.typename} in this recording"
            )

    def keep_padding(self, name: str) -> None:
        """Don't clean a topic's messages: its publisher means something else by their type."""
        self._topics[name].padded = True

    def write(self, topic: str, message: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Take a message of a topic that was added; `flush` writes it."""
        self._topics[topic].waiting.append((log_time_ns, publish_time_ns, message))
        self._received += 1

    def flush(self) -> None:
        """Hand what waits to the system.

        Raises:
            OSError: the disk is full or failed. The messages are given up and counted as
                `unwritten`; what was written before is whole.
        """
        batch: dict[str, Waiting] = {}
        for name, topic in self._topics.items():
            if topic.waiting:
                batch[name] = sorted(topic.waiting, key=lambda item: item[0])
                topic.waiting = []
        while batch:
            batch = self._write(batch)

    def close(self) -> None:
        """Write what waits, finish the file and, in a folder, write `metadata.yaml`.

        A second call changes nothing.

        Raises:
            OSError: the disk is full or failed. The file is finished all the same, if need be at
                the cost of its newest messages, which then are `unwritten`.
        """
        try:
            self.flush()
        finally:
            try:
                self._finish_file()
            finally:
                if not self.options.single_file:
                    self.metadata().write(self.options.target)

    def metadata(self) -> BagMetadata:
        """Return what the recording holds so far."""
        files, counts = list(self._done), Counter(self._done_counts)
        if not self._sink.closed:
            files.append(self._entry())
            counts.update(self._counts())
        topics = tuple(
            TopicEntry(name, topic.typename, topic.type_hash, topic.qos, counts[name])
            for name, topic in self._topics.items()
        )
        return BagMetadata(tuple(files), topics, dict(self._notes()))

    def _write(self, batch: dict[str, Waiting]) -> dict[str, Waiting]:
        """Write what belongs into the current file; return the rest."""
        if self._sink.closed:
            try:
                self._sink = self._open()
            except InputError as error:
                cause = error.__cause__
                raise cause if isinstance(cause, OSError) else error from None
            self._first_ns = None
        if self._first_ns is None:
            self._first_ns = min(items[0][0] for items in batch.values())
        now, rest = batch, dict[str, Waiting]()
        if self.options.file_duration_max:
            span_ns = max(round(self.options.file_duration_max * SECOND_NS), 1)
            now, rest = _divided(batch, self._first_ns + span_ns)
        if now:
            self._sink.write_columns(*(self._columns(name, now[name]) for name in now))
        if rest or 0 < self.options.file_size_max <= self._sink.size:
            self._finish_file()
        return rest

    def _columns(self, name: str, items: Waiting) -> Columns:
        log_times, publish_times, taken = zip(*items, strict=True)
        messages: Sequence[bytes] = taken
        topic = self._topics[name]
        if not topic.padded:
            messages = without_padding(topic.typename, messages, known_types())
        return Columns(
            topic.channel,
            np.array(log_times, np.uint64),
            messages,
            np.array(publish_times, np.uint64),
        )

    def _finish_file(self) -> None:
        if self._sink.closed:
            return

        def final_records() -> dict[str, dict[str, str]]:
            metadata = self.metadata()
            return {NOTES: dict(metadata.custom), "rosbag2": metadata.as_record()}

        try:
            self._sink.close(final_records)
        except OSError:
            if not self._done:
                raise
            # no room for more than a beginning: the recording ends with the file before
            self._sink.path.unlink()
        else:
            self._done.append(self._entry())
            self._done_bytes += self._sink.size
            self._done_counts.update(self._counts())

    def _entry(self) -> FileEntry:
        first, last = self._sink.span_ns
        return FileEntry(self._sink.path.name, first, last, self._sink.message_counts.total())

    def _counts(self) -> dict[str, int]:
        counts = self._sink.message_counts
        return {name: counts[topic.channel] for name, topic in self._topics.items()}

    def _path(self, number: int) -> Path:
        target = self.options.target
        return target if self.options.single_file else target / f"{target.name}_{number}.mcap"

    def _open(self) -> McapSink:
        sink = McapSink(self._path(len(self._done)), compression=self.options.compression)
        try:
            for name, values in self._records.items():
                sink.add_metadata(name, values)
        except OSError as error:
            with contextlib.suppress(OSError):
                sink.close()
            sink.path.unlink()
            raise InputError(f"can't write '{sink.path}': {error.strerror}") from error
        for name, topic in self._topics.items():
            topic.channel = sink.add_channel(name, topic.typename, topic.qos)
        return sink


def _divided(
    batch: dict[str, Waiting], end_ns: int
) -> tuple[dict[str, Waiting], dict[str, Waiting]]:
    """Divide sorted messages into those before a log time and those from it on."""
    before = {name: [item for item in items if item[0] < end_ns] for name, items in batch.items()}
    after = {name: items[len(before[name]) :] for name, items in batch.items()}
    return _filled(before), _filled(after)


def _filled(batch: dict[str, Waiting]) -> dict[str, Waiting]:
    return {name: items for name, items in batch.items() if items}

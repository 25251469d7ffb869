"""Writes a recording as it comes: into a rosbag2 folder with one file after the other, or a file.

Messages wait in memory until `flush`, which the recorder calls more than twice a second, and go to
`McapSink` in order of log time.
"""

from __future__ import annotations

import contextlib
import errno
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.formats.bag_metadata import FileEntry, TopicEntry, write_metadata
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.qos import Qos
from tombo_bag.schemas import load_installed_type
from tombo_dynamics.errors import InputError

_Message = tuple[int, bytes, int]
"""Log time [ns], bytes and publish time [ns]."""


@dataclass(frozen=True)
class RollingOptions:
    """Where and how to record.

    Attributes:
        target: folder to make, or with `single_file` the file.
        single_file: one MCAP file, no folder, no `metadata.yaml`.
        file_size_max: a file that has reached this size [bytes] ends; 0: no limit.
    """

    target: Path
    single_file: bool = False
    file_size_max: int = 0

    def __post_init__(self) -> None:
        """Check what doesn't depend on the disk.

        Raises:
            InputError: a limit below 0, a limit for a single file, or one not called `.mcap`.
        """
        if self.file_size_max < 0 or (self.file_size_max and self.single_file):
            accepted = "0 with a single file" if self.single_file else "0 or more"
            raise InputError(f"file_size_max is {self.file_size_max}; accepted: {accepted}")
        if self.single_file and self.target.suffix != ".mcap":
            raise InputError(f"single_file is '{self.target}'; accepted: a name ending in .mcap")


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
            InputError: the target is there already or can't be written.
        """
        self.options = options
        self._notes = notes
        self._records = {name: dict(values) for name, values in (records or {}).items()}
        self._topics: dict[str, tuple[str, Qos]] = {}
        self._channels: dict[str, int] = {}
        self._waiting: dict[str, list[_Message]] = {}
        self._done: list[FileEntry] = []
        self._done_bytes = 0
        self._done_counts: Counter[str] = Counter()
        self._unfinished = False
        self._received = 0
        target = options.target
        if target.is_symlink() or target.exists():
            raise InputError(f"'{target}' is there already; accepted: a new name")
        try:
            if not options.single_file:
                target.mkdir(parents=True)
        except OSError as error:
            raise InputError(f"can't make folder '{target}': {error.strerror}") from error
        try:
            self._open()
        except OSError as error:
            if not options.single_file:
                target.rmdir()
            raise InputError(f"can't write '{self._next_path()}': {error.strerror}") from error

    @property
    def path(self) -> Path:
        """The file being written, or the last one."""
        return self._sink.path

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
        return self._received - self.messages - sum(map(len, self._waiting.values()))

    def add_topic(self, name: str, typename: str, qos: Qos) -> None:
        """Announce a topic; once more does nothing.

        Raises:
            InputError: unknown type, or the topic is there with another one.
        """
        known, _ = self._topics.setdefault(name, (typename, qos))
        if known != typename:
            raise InputError(f"topic '{name}' has type {typename}; it is {known} already")
        load_installed_type(typename)
        if not self._sink.closed and name not in self._channels:
            self._channels[name] = self._sink.add_channel(name, typename, qos)

    def write(self, topic: str, message: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Take a message of a topic that was added; `flush` writes it."""
        self._waiting.setdefault(topic, []).append((log_time_ns, message, publish_time_ns))
        self._received += 1

    def flush(self) -> None:
        """Hand what waits to the system.

        Raises:
            OSError: the disk is full or failed. The messages are given up and counted as
                `unwritten`; earlier chunks are whole.
        """
        waiting, self._waiting = self._waiting, {}
        if not waiting:
            return
        if self._sink.closed:
            self._open()
        self._sink.write_columns(
            *(
                Columns(self._channels[name], *zip(*of, strict=True))
                for name, of in waiting.items()
            )
        )
        if 0 < self.options.file_size_max <= self._sink.size:
            self._finish_file()

    def close(self) -> None:
        """Write what waits, finish the file and, in a folder, write `metadata.yaml`.

        A second call changes nothing.

        Raises:
            OSError: the disk is full or failed. All chunks are whole and can be read; without
                a finished file `metadata.yaml` is missing.
        """
        try:
            self.flush()
        finally:
            if not self._sink.closed:
                self._finish_file()
            if not (self.options.single_file or self._unfinished):
                counts = self._done_counts
                topics = [
                    TopicEntry(name, typename, qos, counts[name])
                    for name, (typename, qos) in self._topics.items()
                ]
                write_metadata(self.options.target, self._done, topics, self._notes())

    def _finish_file(self) -> None:
        sink, self._unfinished = self._sink, True
        try:
            try:
                sink.add_metadata(RECORDER_METADATA, dict(self._notes()))
            finally:
                sink.close()
        finally:
            self._done_bytes += sink.size
            self._done_counts.update(self._counts(sink))
        self._unfinished = False
        messages = sink.message_counts.total()
        self._done.append(FileEntry(sink.path.name, *sink.span_ns, messages))

    def _counts(self, sink: McapSink) -> dict[str, int]:
        """Return the messages in a file by topic."""
        return {name: sink.message_counts[channel] for name, channel in self._channels.items()}

    def _next_path(self) -> Path:
        target = self.options.target
        name = f"{target.name}_{len(self._done)}.mcap"
        return target if self.options.single_file else target / name

    def _open(self) -> None:
        """Begin the next file.

        Raises:
            OSError: it can't be written; then it is not there.
        """
        path = self._next_path()
        if path.exists():  # after a file that could not be finished
            raise FileExistsError(errno.EEXIST, "it is there already")
        try:
            sink = McapSink(path)
        except InputError as error:
            raise error.__cause__ or error from None  # the OSError
        try:
            for record, values in self._records.items():
                sink.add_metadata(record, values)
        except OSError:
            with contextlib.suppress(OSError):
                sink.close()
            sink.path.unlink()
            raise
        self._sink = sink
        self._channels = {
            topic: sink.add_channel(topic, typename, qos)
            for topic, (typename, qos) in self._topics.items()
        }

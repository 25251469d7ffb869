"""Writes a recording as it comes, into a rosbag2 folder or into one file.

Messages wait in memory until `flush`, which the recorder calls more than twice a second, and go to
`McapSink` in order of log time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.formats.bag_metadata import TopicEntry, write_metadata
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.qos import Qos
from tombo_bag.schemas import load_installed_type
from tombo_dynamics.errors import InputError

_Message = tuple[int, bytes, int]
"""Log time [ns], bytes and publish time [ns]."""


class BagSink:
    """A recording. `close` finishes it, whatever happened before."""

    def __init__(
        self,
        target: Path,
        notes: Callable[[], Mapping[str, str]] = dict,
        records: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        """Make the folder, if there is one, and the file.

        Args:
            target: file to write, ending in `.mcap`, without `metadata.yaml`; else a folder.
            notes: returns what to write into the finished file, as the metadata record
                `tombo_recorder`, and into `metadata.yaml`.
            records: metadata records to begin the file with: name → values.

        Raises:
            InputError: the target is there already or can't be written.
        """
        self.target = target
        self._in_folder = target.suffix != ".mcap"
        self._notes = notes
        self._topics: dict[str, tuple[int, str, Qos]] = {}
        self._waiting: dict[str, list[_Message]] = {}
        self._received = 0
        if target.is_symlink() or target.exists():
            raise InputError(f"'{target}' is there already; accepted: a new name")
        try:
            if self._in_folder:
                target.mkdir(parents=True)
        except OSError as error:
            raise InputError(f"can't make folder '{target}': {error.strerror}") from error
        path = target / f"{target.name}_0.mcap" if self._in_folder else target
        try:
            self._sink = McapSink(path, records or {})
        except InputError:
            if self._in_folder:
                target.rmdir()
            raise

    @property
    def path(self) -> Path:
        """The file."""
        return self._sink.path

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._sink.size

    @property
    def messages(self) -> int:
        """Messages written so far."""
        return self._sink.message_counts.total()

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
        load_installed_type(typename)
        channel = self._sink.add_channel(name, typename, qos)
        self._topics.setdefault(name, (channel, typename, qos))

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
        if waiting:
            self._sink.write_columns(
                *(
                    Columns(self._topics[name][0], *zip(*of, strict=True))
                    for name, of in waiting.items()
                )
            )

    def close(self) -> None:
        """Write what waits, finish the file and, in a folder, write `metadata.yaml`.

        A second call does nothing.

        Raises:
            OSError: the disk is full or failed. All chunks are whole and can be read; without
                a finished file `metadata.yaml` is missing.
        """
        if self._sink.closed:
            return
        try:
            self.flush()
        finally:
            self._finish()

    def _finish(self) -> None:
        try:
            self._sink.add_metadata(RECORDER_METADATA, dict(self._notes()))
        finally:
            self._sink.close()
        if self._in_folder:
            counts = self._sink.message_counts
            topics = [
                TopicEntry(name, typename, qos, counts[channel])
                for name, (channel, typename, qos) in self._topics.items()
            ]
            write_metadata(self.path, self._sink.span_ns, topics, self._notes())

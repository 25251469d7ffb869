"""One file of a recording, of whatever kind: the part that all kinds have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.formats.unpacking import ZSTD_MAGIC, unpack
from tombo_bag.schemas import Types, known_types
from tombo_dynamics.errors import InputError

READABLE = "an MCAP file, a rosbag2 folder, an SQLite .db3 or a ROS 1 .bag"


@dataclass(frozen=True)
class TopicSummary:
    """One topic of one file.

    Attributes:
        typename: message type in its long form, as `nav_msgs/msg/Odometry`.
        count: number of messages; in a damaged file, the announced number.
        first_ns: log time of the first message, 0 if there is none.
        last_ns: log time of the last message, 0 if there is none.
    """

    typename: str
    count: int
    first_ns: int
    last_ns: int

    @classmethod
    def of(cls, typename: str, extents: Iterable[tuple[int, int, int]]) -> TopicSummary:
        """Join parts of a topic: number of messages, first and last log time [ns] of each."""
        filled = [extent for extent in extents if extent[0]]
        return cls(
            typename,
            sum(count for count, _, _ in filled),
            min((first for _, first, _ in filled), default=0),
            max((last for _, _, last in filled), default=0),
        )


@dataclass(frozen=True)
class RawMessages:
    """Messages of one topic in order of log time, not taken apart."""

    log_times_ns: NDArray[np.int64]
    publish_times_ns: NDArray[np.int64]
    messages: list[bytes]


class BagFile(ABC):
    """A file of recorded messages, opened.

    Attributes:
        path: the file.
        topics: its topics by name.
        metadata: named text values of the file.
        damage: unreadable parts so far, a line each.
    """

    path: Path
    topics: Mapping[str, TopicSummary]
    metadata: Mapping[str, Mapping[str, str]]
    damage: Sequence[str]

    @abstractmethod
    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of those of the topics that are here: CDR, in order of log time."""

    def types(self, topic: str) -> Types:
        """Return the definition of a topic's type and of all it depends on.

        Where the file itself has none, that of ROS 2 Jazzy and of `tombo_msgs`.

        Raises:
            InputError: the type is not known, or its messages are in no format that can be read.
        """
        typename, types = self.topics[topic].typename, known_types()
        if typename not in types:
            raise InputError(
                f"'{self.path}': topic {topic} has type '{typename}', of which the file has no "
                "definition; accepted: a type of ROS 2 Jazzy or tombo_msgs"
            )
        return types

    def close(self) -> None:  # noqa: B027 - a hook
        """Close what is still open of the file."""


def by_topic(
    topics: Iterable[str], rows: Iterable[tuple[str, int, bytes]]
) -> dict[str, RawMessages]:
    """Return messages of these topics, of which topic, log time [ns] and bytes come as rows."""
    times: dict[str, list[int]] = {topic: [] for topic in topics}
    messages: dict[str, list[bytes]] = {topic: [] for topic in times}
    for topic, time, message in rows:
        times[topic].append(time)
        messages[topic].append(message)
    return {topic: in_log_order(of, of, messages[topic]) for topic, of in times.items()}


def in_log_order(log_ns: Any, publish_ns: Any, messages: list[bytes]) -> RawMessages:
    """Put messages, of which log and publish times [ns] are given, into the order of log time."""
    log, publish = np.asarray(log_ns, np.int64), np.asarray(publish_ns, np.int64)
    if np.any(log[1:] < log[:-1]):
        order = np.argsort(log, kind="stable")
        log, publish = log[order], publish[order]
        messages = [messages[i] for i in order.tolist()]
    return RawMessages(log, publish, messages)


def plain(raw: RawMessages) -> RawMessages:
    """Unpack messages that rosbag2 compressed one by one; CDR itself never starts like zstd."""
    if not raw.messages or not raw.messages[0].startswith(ZSTD_MAGIC):
        return raw
    messages = [_unpacked(message) for message in raw.messages]
    return RawMessages(raw.log_times_ns, raw.publish_times_ns, messages)


def _unpacked(message: bytes) -> bytes:
    try:
        return bytes(unpack("zstd", message))
    except ValueError:
        return b""  # fits no type, and is counted as damage there

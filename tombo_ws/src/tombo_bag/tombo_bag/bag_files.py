"""One file of a recording, of whatever kind: the part that all kinds have in common."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from tombo_bag.reader import Bag, RawMessages
from tombo_bag.schemas import Types, known_types, parse_schema
from tombo_dynamics.errors import InputError

READABLE = "an MCAP file, a rosbag2 folder, an SQLite .db3 or a ROS 1 .bag"


@dataclass(frozen=True)
class Stream:
    """One topic of one file.

    Attributes:
        typename: message type in its long form, as `nav_msgs/msg/Odometry`.
        count: number of messages; for a damaged file, those that are announced.
        first_ns: log time of the first message, 0 if there is none.
        last_ns: log time of the last message, 0 if there is none.
    """

    typename: str
    count: int
    first_ns: int
    last_ns: int


class BagFile(Protocol):
    """A file of recorded messages, opened."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def streams(self) -> Mapping[str, Stream]:
        """Its topics by name."""
        ...

    @property
    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Named text values that stand beside the messages."""
        ...

    @property
    def damage(self) -> Sequence[str]:
        """What could not be read so far, a line each."""
        ...

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some of its topics: CDR, in order of log time."""
        ...

    def types(self, topic: str) -> Types:
        """Return the definition of a topic's type and of all it depends on.

        Raises:
            InputError: the type is not known, or its messages are in no format that can be read.
        """
        ...

    def close(self) -> None:
        """Close the file."""
        ...


class McapFile:
    """An MCAP file; see `reader.Bag`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bag = Bag(path)
        self.streams: dict[str, Stream] = {
            name: Stream(topic.typename, topic.count, topic.first_ns, topic.last_ns)
            for name, topic in self._bag.topics.items()
        }
        self.metadata: dict[str, dict[str, str]] = {
            record.name: record.metadata for record in self._bag.metadata
        }

    @property
    def damage(self) -> list[str]:
        """What could not be read so far, a line each."""
        return [damage.text for damage in self._bag.damage]

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Read the messages of some topics, each chunk once."""
        here = [topic for topic in topics if topic in self.streams]
        groups = self._bag.message_groups(*(self._channels(topic) for topic in here))
        return dict(zip(here, groups, strict=True))

    def types(self, topic: str) -> Types:
        """Return a topic's type as the file itself describes it, else as ROS 2 Jazzy does."""
        channel = self._bag.channels[self._channels(topic)[0]]
        schema = self._bag.schemas.get(channel.schema_id)
        if channel.message_encoding != "cdr" or schema is None:
            raise InputError(
                f"'{self.path}': topic {topic} has messages in '{channel.message_encoding}'; "
                "accepted: 'cdr' with a schema"
            )
        if schema.encoding == "ros2msg":
            return parse_schema(schema.name, schema.data.decode("utf-8", "replace"))
        return jazzy_type(schema.name, f"'{self.path}': topic {topic}")

    def close(self) -> None:
        """Do nothing: the file is closed."""

    def _channels(self, topic: str) -> list[int]:
        return [n for n, channel in self._bag.channels.items() if channel.topic == topic]


def jazzy_type(typename: str, where: str) -> Types:
    """Return the types of ROS 2 Jazzy and of `tombo_msgs`, which must contain `typename`.

    Raises:
        InputError: it is none of them.
    """
    types = known_types()
    if typename not in types:
        raise InputError(
            f"{where} has type '{typename}', of which the file has no definition; accepted: a "
            "type of ROS 2 Jazzy or tombo_msgs"
        )
    return types


def in_log_order(times_ns: Sequence[int], messages: list[bytes]) -> RawMessages:
    """Put messages that stand in any order into the order of log time."""
    times = np.array(times_ns, np.int64)
    if np.any(times[1:] < times[:-1]):
        order = np.argsort(times, kind="stable")
        times, messages = times[order], [messages[i] for i in order.tolist()]
    return RawMessages(times, times, messages)

"""Rigid bodies that a driver of motion capture publishes together, as a topic for each of them.

`/poses`, a NamedPoseArray with bodies `drone` and `wand`, is read as `/poses/drone` and
`/poses/wand`, PoseStamped. So a body is chosen as a topic is, wherever poses are read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable, columns_of
from tombo_bag.formats.bag_files import BagFile, RawMessages, TopicSummary, in_log_order
from tombo_bag.message_codec import encoded
from tombo_bag.topics import MOCAP_POSE


class _Bodies(NamedTuple):
    """Where a message has its bodies: the sequence, and the name in each."""

    sequence: str
    name: str


_TYPES = {
    "motion_capture_tracking_interfaces/msg/NamedPoseArray": _Bodies("poses", "name"),
    "mocap4r2_msgs/msg/RigidBodies": _Bodies("rigidbodies", "rigid_body_name"),
}
"""Type of the driver's messages → where they have their bodies."""
_POSE = (("position", "position", "xyz"), ("attitude", "orientation", "xyzw"))
"""Field of a pose here, and in the message with its axes."""


class RigidBodies(BagFile):
    """The bodies of one topic of a file, as topics of a file of their own."""

    def __init__(self, file: BagFile, topic: str, raw: RawMessages) -> None:
        """Take the messages apart.

        Raises:
            InputError: they don't fit their type, or its definition is not known.
        """
        self.path, self.metadata, self.damage = file.path, {}, ()
        typename = file.topics[topic].typename
        table = columns_of(typename, raw.messages, file.types(topic))
        self._messages = dict(_by_body(topic, _TYPES[typename], table, raw))
        self.topics = {
            name: TopicSummary(
                MOCAP_POSE.typename, len(poses.messages), *map(int, poses.log_times_ns[[0, -1]])
            )
            for name, poses in self._messages.items()
        }

    def messages(self, topics: Collection[str]) -> dict[str, RawMessages]:
        """Return the poses of some bodies."""
        return {name: poses for name, poses in self._messages.items() if name in topics}


def _by_body(
    topic: str, bodies: _Bodies, table: ColumnTable, raw: RawMessages
) -> Iterator[tuple[str, RawMessages]]:
    """Yield a topic for each body, and its poses in order of log time."""
    columns: dict[str, list[tuple[NDArray[np.intp], ColumnTable]]] = {}
    place = 0
    while f"{bodies.sequence}[{place}].{bodies.name}" in table:
        body = f"{bodies.sequence}[{place}]"
        names = table[f"{body}.{bodies.name}"]
        for name in np.unique(names[names != ""]):
            rows = np.flatnonzero(names == name)
            pose = {
                key: np.column_stack([table[f"{body}.pose.{path}.{axis}"][rows] for axis in axes])
                for key, path, axes in _POSE
            }
            header = {"stamp_ns": table["stamp_ns"], "frame_id": table["header.frame_id"]}
            given = {key: column[rows] for key, column in header.items()} | pose
            columns.setdefault(str(name).strip("/"), []).append((rows, given))
        place += 1
    for name, parts in columns.items():
        rows = np.concatenate([part[0] for part in parts])
        given = {key: np.concatenate([p[1][key] for p in parts]) for key in parts[0][1]}
        messages = list(encoded(MOCAP_POSE.typename, given))
        ordered = in_log_order(raw.log_times_ns[rows], raw.publish_times_ns[rows], messages)
        yield f"{topic}/{name}", ordered


def bodies_in(
    files: Sequence[BagFile], read: Callable[[BagFile, str], RawMessages]
) -> Iterator[RigidBodies]:
    """Yield the rigid bodies of all topics that hold several.

    Args:
        files: of a recording.
        read: returns the messages of a topic of a file.

    Raises:
        InputError: as `RigidBodies`.
    """
    for file in files:
        for topic, stream in file.topics.items():
            if stream.typename in _TYPES and stream.count:
                raw = read(file, topic)
                if raw.messages:
                    yield RigidBodies(file, topic, raw)

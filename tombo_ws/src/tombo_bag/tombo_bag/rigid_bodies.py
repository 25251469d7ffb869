"""Rigid bodies that a driver of motion capture publishes together, as a topic for each of them.

`/poses`, a NamedPoseArray with bodies `drone` and `wand`, is read as `/poses/drone` and
`/poses/wand`, PoseStamped. So a body is chosen as a topic is, wherever poses are read.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable, columns_of
from tombo_bag.formats.bag_files import BagFile, RawMessages, TopicSummary, in_log_order, plain
from tombo_bag.message_codec import encoded
from tombo_bag.topics import MOCAP_POSE, POSE_TYPES
from tombo_dynamics.rotation import body_to_map, quaternion_multiply
from tombo_dynamics.time_base import SECOND_NS


class BodyList(NamedTuple):
    """Where a message has its bodies."""

    sequence: str
    name: str
    position: str
    attitude: str
    header: str
    """Path of the header; `{body}` is replaced by that of the body."""


_TF = "tf2_msgs/msg/TFMessage"
BODY_LISTS = {
    "motion_capture_tracking_interfaces/msg/NamedPoseArray": BodyList(
        "poses", "name", "pose.position", "pose.orientation", "header"
    ),
    "mocap4r2_msgs/msg/RigidBodies": BodyList(
        "rigidbodies", "rigid_body_name", "pose.position", "pose.orientation", "header"
    ),
    _TF: BodyList(
        "transforms", "child_frame_id", "transform.translation", "transform.rotation",
        "{body}.header",
    ),
}  # fmt: skip
"""Type of the driver's messages → where they have their bodies."""


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
        self._messages = dict(_by_body(topic, BODY_LISTS[typename], table, raw))
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
    topic: str, bodies: BodyList, table: ColumnTable, raw: RawMessages
) -> Iterator[tuple[str, RawMessages]]:
    """Yield a topic for each body, and its poses in order of log time."""
    columns: dict[str, list[tuple[NDArray[np.intp], ColumnTable]]] = {}
    place = 0
    while f"{bodies.sequence}[{place}].{bodies.name}" in table:
        body = f"{bodies.sequence}[{place}]"
        header = bodies.header.format(body=body)
        names = table[f"{body}.{bodies.name}"]
        for name in np.unique(names[names != ""]):
            rows = np.flatnonzero(names == name)
            stamps = [table[f"{header}.stamp.{part}"][rows] for part in ("sec", "nanosec")]
            pose = {
                key: np.column_stack([table[f"{body}.{path}.{axis}"][rows] for axis in axes])
                for key, path, axes in (
                    ("position", bodies.position, "xyz"),
                    ("attitude", bodies.attitude, "xyzw"),
                )
            }
            stamp_ns = stamps[0].astype(np.int64) * SECOND_NS + stamps[1].astype(np.int64)
            frame_id = table[f"{header}.frame_id"][rows]
            given = {"stamp_ns": stamp_ns, "frame_id": frame_id, **pose}
            columns.setdefault(str(name).strip("/"), []).append((rows, given))
        place += 1
    frames = {
        name: (
            np.concatenate([rows for rows, _ in parts]),
            {key: np.concatenate([given[key] for _, given in parts]) for key in parts[0][1]},
        )
        for name, parts in columns.items()
    }
    parents = {str(given["frame_id"][0]).strip("/") for _, given in frames.values()}
    for name in [name for name in frames if name not in parents] or frames:
        rows, given = _from_root(name, frames)
        messages = list(encoded(MOCAP_POSE.typename, given))
        ordered = in_log_order(raw.log_times_ns[rows], raw.publish_times_ns[rows], messages)
        yield f"{topic}/{name}", ordered


def _from_root(
    name: str, frames: Mapping[str, tuple[NDArray[np.intp], ColumnTable]]
) -> tuple[NDArray[np.intp], ColumnTable]:
    """Return a body's poses in the outermost frame, by the newest transform of each one between.

    A pose before the first of these transforms is left out.
    """
    rows, pose = frames[name]
    for _ in frames:
        parent = str(pose["frame_id"][0]).strip("/")
        if parent not in frames or parent == name:
            break
        theirs, above = frames[parent]
        order = np.argsort(theirs, kind="stable")
        newest = np.searchsorted(theirs[order], rows, side="right") - 1
        known = newest >= 0
        rows, newest = rows[known], order[newest[known]]
        pose = {key: values[known] for key, values in pose.items()}
        turn = above["attitude"][newest]
        pose["position"] = above["position"][newest] + body_to_map(turn, pose["position"])
        pose["attitude"] = quaternion_multiply(turn, pose["attitude"])
        pose["frame_id"] = above["frame_id"][newest]
    return rows, pose


def bodies_in(files: Sequence[BagFile]) -> Iterator[RigidBodies]:
    """Yield the rigid bodies of all topics of a recording's files that hold several.

    Transforms count where no other topic has poses: they repeat those of a driver or a node.

    Raises:
        InputError: as `RigidBodies`.
    """
    there = {stream.typename for file in files for stream in file.topics.values() if stream.count}
    others = there & {*POSE_TYPES, *BODY_LISTS} - {_TF}
    for file in files:
        for topic, stream in file.topics.items():
            wanted = stream.typename in BODY_LISTS and (stream.typename != _TF or not others)
            if wanted and stream.count:
                raw = plain(file.messages([topic])[topic])
                if raw.messages:
                    yield RigidBodies(file, topic, raw)

"""The poses of a recording, of any of several types and topics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_bag.formats.bag_files import Stream
from tombo_bag.message_codec import fields_of
from tombo_bag.recording import Recording
from tombo_bag.topics import MOCAP_POSE, POSE_TYPES, TOPICS
from tombo_dynamics.arrays import Array, Times
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP


@dataclass(frozen=True)
class PoseTrack:
    """Poses of base_link as they arrived, N of them."""

    arrival_ns: Times
    """Log times, never falling."""
    stamp_ns: Times
    """Capture times of the headers."""
    frame: NDArray[np.str_]
    position: Array
    """(N, 3) [m]."""
    attitude: Array
    """(N, 4) quaternions xyzw, as recorded."""

    @staticmethod
    def none() -> PoseTrack:
        """Return a track without poses."""
        times = np.zeros(0, np.int64)
        return PoseTrack(times, times, np.zeros(0, "U1"), np.zeros((0, 3)), np.zeros((0, 4)))

    def renamed(self, accepted: str) -> PoseTrack:
        """Return the track with frame `accepted` taken for map."""
        return replace(self, frame=np.where(self.frame == accepted, FRAME_MAP, self.frame))

    def shifted(self, shift_ns: int) -> PoseTrack:
        """Return the track with all stamps moved."""
        return replace(self, stamp_ns=self.stamp_ns + shift_ns)

    def with_arrival_stamps(self) -> PoseTrack:
        """Return the track with the arrival as stamp."""
        return replace(self, stamp_ns=self.arrival_ns)


def find_pose_topic(topics: Mapping[str, Stream]) -> str | None:
    """Return the topic with the vehicle's poses; None if there is no candidate.

    Raises:
        InputError: several candidates, or `/mocap/pose` has a type that holds no pose.
    """
    known = topics.get(MOCAP_POSE.name)
    if known is not None:
        if known.typename not in POSE_TYPES:
            raise InputError(
                f"{MOCAP_POSE.name} has type {known.typename}; accepted: {', '.join(POSE_TYPES)}"
            )
        return MOCAP_POSE.name
    found = [
        name
        for name, stream in topics.items()
        if stream.typename in POSE_TYPES and stream.count and name not in TOPICS
    ]
    if len(found) > 1:
        listed = ", ".join(f"{name} ({topics[name].count} messages)" for name in found)
        raise InputError(
            f"several topics could be the vehicle's poses: {listed}; accepted: "
            f"--map TOPIC:={MOCAP_POSE.name} with one of them"
        )
    return found[0] if found else None


def read_poses(recording: Recording, topic: str) -> PoseTrack:
    """Read a topic of one of `POSE_TYPES`."""
    fields = fields_of(recording.topics[topic].typename, recording.columns(topic))
    return PoseTrack(
        fields["log_time_ns"],
        fields["stamp_ns"],
        fields.get("frame_id", np.zeros(0, "U1")),
        fields.get("position", np.zeros((0, 3))),
        fields.get("attitude", np.zeros((0, 4))),
    )

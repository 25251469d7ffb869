"""Data that a replay takes from a recording: parameters, the clock of the nodes, poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.formats.bag_files import TopicSummary
from tombo_bag.message_codec import fields_of
from tombo_bag.recording import Recording
from tombo_bag.topics import (
    IMU,
    MISSION_SETPOINT,
    MOCAP_POSE,
    ODOMETRY,
    POSE_TYPES,
    SETPOINT,
    TOPICS,
)
from tombo_dynamics.arrays import Array, Times
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP
from tombo_flight.recorded_flight import scenario_of_metadata
from tombo_flight.scenario import Scenario, as_mapping, scenario_over


def scenario_of_bag(
    metadata: Mapping[str, Mapping[str, str]],
    name: str | None = None,
    settings: Sequence[str] = (),
) -> tuple[Scenario, list[str]]:
    """Return the scenario to replay with, and a line on where it comes from.

    Args:
        metadata: of the recording.
        name: a scenario, name or path, over that of the recording.
        settings: `key=value` over both.

    Raises:
        InputError: `name` or `settings` are bad.
    """
    flown = metadata.get(FLIGHT_METADATA, {})
    base, label, findings = {}, "recording", []
    if "scenario" not in flown:
        findings.append("no parameters in the bag: the suite's defaults are used")
    else:
        try:
            _, scenario = scenario_of_metadata(flown)
            base, label = as_mapping(scenario), scenario.name
        except InputError as error:
            findings.append(f"parameters in the bag can't be used ({error}): defaults instead")
    return scenario_over(base, label, name, settings), findings


CLOCK_TOPICS = (MISSION_SETPOINT.name, SETPOINT.name)
"""Topics whose stamps are the nodes' now."""
_APART_NS = 250_000_000
"""Nearer clocks are one clock."""


def find_suite_clock(recording: Recording) -> tuple[Times, Times] | None:
    """Return log times, rising, and the nodes' time at each; None if it is the recorder's.

    A node's set points are stamped when they are said. Now is then the newest stamp that has
    been recorded, of set points and of whatever else is stamped by the same clock.
    """
    topics = recording.topics
    there = [name for name in (*CLOCK_TOPICS, ODOMETRY.name, IMU.name) if _count(topics, name)]
    if not there or there[0] not in CLOCK_TOPICS:
        return None
    recording.load(there)
    pairs: list[tuple[Times, Times]] = []
    for topic in there:
        table = recording.columns(topic)
        if "stamp_ns" not in table or not len(table["stamp_ns"]):
            continue
        log, stamp = table["log_time_ns"], table["stamp_ns"]
        reported = np.interp(log, *pairs[0]) if pairs else stamp
        if abs(float(np.median(stamp - reported))) < _APART_NS:
            pairs.append((log, stamp))
    if not pairs or abs(float(np.median(pairs[0][1] - pairs[0][0]))) < _APART_NS:
        return None
    log, stamp = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    order = np.argsort(log, kind="stable")
    return log[order], np.maximum.accumulate(stamp[order])


def _count(topics: Mapping[str, TopicSummary], name: str) -> int:
    return topics[name].count if name in topics else 0


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


def find_pose_topic(topics: Mapping[str, TopicSummary]) -> str | None:
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

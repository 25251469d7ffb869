"""Replays a recording through the pure cores and compares: `tombo replay` without the terminal."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.recording import Recording
from tombo_bag.topics import COLLISION_EVENT, MOCAP_POSE, TOPICS, TRUE_CONTACT
from tombo_dynamics.errors import InputError, unknown_name
from tombo_flight.replay.cores import Inputs, through_cores
from tombo_flight.replay.metrics import Context, metrics_of
from tombo_flight.replay.outputs import (
    NODES,
    SERIES,
    Outputs,
    OutputSeries,
    outputs_of,
    read_outputs,
)
from tombo_flight.replay.prechecks import check_poses
from tombo_flight.replay.recorded import (
    CLOCK_TOPICS,
    PoseTrack,
    find_pose_topic,
    find_suite_clock,
    read_poses,
    scenario_of_bag,
)

_STATISTIC_ERROR = 1e-9
"""Largest difference of a recorded statistic from filterpy's; relative above 1."""


@dataclass(frozen=True)
class ReplayRequest:
    """What to replay, and how."""

    nodes: tuple[str, ...] = ()
    """Empty: every node whose inputs are there."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Topic as recorded → name of the suite."""
    frame_ok: str | None = None
    shift_stamps_s: float = 0.0
    stamp_on_arrival: bool = False
    scenario: str | None = None
    settings: tuple[str, ...] = ()


@dataclass
class Replay:
    """The results."""

    bag: Path
    begin_ns: int = 0
    """Log time at which the recording begins; times in figures count from it."""
    duration_s: float = 0.0
    nodes: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Figures by node."""
    findings: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)
    """Figures beyond the tolerances."""
    recorded: Outputs = field(default_factory=Outputs)
    replayed: Outputs = field(default_factory=Outputs)
    seconds: float = 0.0

    def as_mapping(self) -> dict[str, Any]:
        """Return what `--json` prints."""
        factor = self.duration_s / self.seconds if self.seconds > 0.0 else None
        return {
            "bag": str(self.bag),
            "duration_s": self.duration_s,
            "nodes": self.nodes,
            "differences": self.differences,
            "findings": self.findings,
            "damage": self.damage,
            "speed": {"real_time_factor": factor, "seconds": self.seconds},
        }


def replay_bag(path: Path, request: ReplayRequest) -> Replay:
    """Replay a recording, a file or a folder, and compare.

    Raises:
        InputError: the recording can't be read, no node can be replayed, or the request is bad.
    """
    began = time.perf_counter()
    for source, name in request.names.items():
        if name not in TOPICS:
            raise unknown_name(f"topic in --map {source}:=", name, TOPICS)
    with Recording(path, request.names) as recording:
        result = Replay(path)
        inputs = _prepare(recording, request, result)
        result.recorded = read_outputs(recording, outputs_of(inputs.nodes))
        result.replayed, reported = through_cores(inputs)
        context = Context(result.begin_ns, _contacts(recording))
        for node in inputs.nodes:
            metrics, differences = metrics_of(node, result.recorded, result.replayed, context)
            result.nodes[node] = {**metrics, **reported.get(node, {})}
            result.differences += [f"{node}: {text}" for text in differences]
        result.findings = inputs.findings
        if "detector" in inputs.nodes and "statistic" in result.recorded.series:
            _check_statistic(inputs, result.recorded.series["statistic"], result)
        result.damage = recording.damage
    result.seconds = time.perf_counter() - began
    return result


def _prepare(recording: Recording, request: ReplayRequest, result: Replay) -> Inputs:
    topics = recording.topics
    scenario, findings = scenario_of_bag(recording.metadata, request.scenario, request.settings)
    findings += _losses(recording.metadata)
    pose_topic = find_pose_topic(topics)
    there = {name for name, stream in topics.items() if stream.count}
    if pose_topic is not None and pose_topic in there:
        there.add(MOCAP_POSE.name)
        if pose_topic != MOCAP_POSE.name:
            findings.append(f"poses are taken from {pose_topic}, the only candidate")
    asked = request.nodes or tuple(NODES)
    missing = {name: [t for t in NODES[name].inputs if t not in there] for name in asked}
    nodes = [name for name in asked if not missing[name]]
    why = [f"{n} can't be replayed: no {', '.join(m)} in the bag" for n, m in missing.items() if m]
    findings += why
    if not nodes:
        why += [f"damage: {line}" for line in recording.damage]
        listed = ", ".join(f"{name} ({stream.typename})" for name, stream in topics.items())
        raise InputError(
            f"'{recording.path}': nothing to replay ({'; '.join(why)}); its "
            f"topics: {listed or 'none'}; accepted: --map TOPIC:=NAME for topics of another name"
        )
    wanted = {topic for name in nodes for topic in NODES[name].core.inputs}
    wanted |= {SERIES[name].topic for name in outputs_of(nodes) if name in SERIES}
    wanted |= {TRUE_CONTACT.name, COLLISION_EVENT.name}
    wanted |= set([name for name in CLOCK_TOPICS if name in there][:1])
    if MOCAP_POSE.name in wanted and pose_topic is not None:
        wanted = wanted - {MOCAP_POSE.name} | {pose_topic}
    recording.load(sorted(wanted & set(topics)))
    clock = find_suite_clock(recording)
    if clock is not None:
        recording.set_clock(*clock)
        findings.append("the nodes' clock was not the recorder's: messages arrive by the nodes'")
    poses = PoseTrack.none()
    if pose_topic is not None and pose_topic in wanted:
        poses = _arranged(read_poses(recording, pose_topic), request)
        findings += check_poses(poses, scenario.detector.gap_max)
    spans = [(s.first_ns, s.last_ns) for s in topics.values() if s.count and s.last_ns]
    if spans:
        extent = np.array([min(a for a, _ in spans), max(b for _, b in spans)])
        begin, end = recording.on_clock(extent).tolist()
        result.begin_ns, result.duration_s = begin, (end - begin) / 1e9
    return Inputs(recording, scenario, tuple(nodes), poses, findings)


def _check_statistic(inputs: Inputs, recorded: OutputSeries, result: Replay) -> None:
    """Compare the recorded statistic with that of filterpy's own filter; add what differs."""
    from tombo_collision.reference_filter import reference_statistics  # filterpy takes 0.5 s

    stamps_ns = inputs.poses.stamp_ns.tolist()
    expected = reference_statistics(*inputs.stream(MOCAP_POSE.name), inputs.scenario.detector)
    by_stamp = dict(zip(stamps_ns, expected.tolist(), strict=True))
    # Of several poses with one stamp, it is not known which one a status belongs to.
    unique = {stamp for stamp, count in Counter(stamps_ns).items() if count == 1}
    rows = [
        (stamp, value, by_stamp[stamp])
        for stamp, (value,) in zip(
            recorded.stamp_ns.tolist(), recorded.values.tolist(), strict=True
        )
        if stamp in unique
    ]
    differing = [
        row for row in rows if not abs(row[1] - row[2]) <= _STATISTIC_ERROR * max(1.0, row[2])
    ]
    result.nodes["detector"]["filterpy"] = {"compared": len(rows), "differing": len(differing)}
    if differing:
        stamp, value, reference = differing[0]
        result.findings.append(
            f"the recorded statistic of {len(differing)} of {len(rows)} poses is not that of"
            f" filterpy's filter, first {value:.9g} for {reference:.9g} at"
            f" {1e-9 * (stamp - result.begin_ns):.3f} s: other parameters of the detector, poses"
            " that were not recorded, or another detector"
        )


def _losses(metadata: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return the losses that the recorder has reported."""
    lost = metadata.get(RECORDER_METADATA, {}).get("lost", "0")
    if not lost.isdecimal() or int(lost) == 0:
        return []
    return [f"the recorder lost {lost} messages: nodes that got them are replayed without"]


def _arranged(poses: PoseTrack, request: ReplayRequest) -> PoseTrack:
    if request.frame_ok is not None:
        poses = poses.renamed(request.frame_ok)
    if request.stamp_on_arrival:
        poses = poses.with_arrival_stamps()
    return poses.shifted(round(1e9 * request.shift_stamps_s))


def _contacts(recording: Recording) -> list[int] | None:
    """Return the stamps at which true contacts begin; None if the truth is not recorded."""
    if TRUE_CONTACT.name not in recording.topics:
        return None
    table = recording.columns(TRUE_CONTACT.name)
    if "in_contact" not in table:
        return []
    touching = table["in_contact"].astype(bool)
    begins = touching & ~np.concatenate([[False], touching[:-1]])
    stamps: list[int] = table["stamp_ns"][begins].tolist()
    return stamps

"""Replays a recording through the pure cores and compares: `tombo replay` without the terminal."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.recording import Recording
from tombo_bag.topics import COLLISION_EVENT, DETECTOR_STATUS, MOCAP_POSE, TOPICS, TRUE_CONTACT
from tombo_dynamics.errors import InputError, unknown_name
from tombo_flight.replay.compared import (
    NODES,
    NOTHING,
    NodeComparison,
    Stream,
    compare_streams,
    needed_inputs,
)
from tombo_flight.replay.cores import (
    CLOCK_TOPICS,
    Inputs,
    find_suite_clock,
    scenario_of_bag,
    through_core,
)
from tombo_flight.replay.poses import PoseTrack, check_poses, find_pose_topic, read_poses
from tombo_flight.report.page import Page, Section, Table, Text

_STATISTIC_ERROR = 1e-9
"""Largest difference of a recorded statistic from filterpy's; relative above 1."""


@dataclass(frozen=True)
class ReplayRequest:
    """Recording to replay, and its options."""

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
    nodes: dict[str, NodeComparison] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    published: dict[str, Stream] = field(default_factory=dict)
    """Topic → messages of the replay."""
    seconds: float = 0.0

    @property
    def differences(self) -> list[str]:
        """Figures beyond the tolerances."""
        return [f"{node}: {text}" for node, of in self.nodes.items() for text in of.differences]

    def as_mapping(self) -> dict[str, Any]:
        """Return what `--json` prints."""
        factor = self.duration_s / self.seconds if self.seconds > 0.0 else None
        return {
            "bag": str(self.bag),
            "duration_s": self.duration_s,
            "nodes": {node: found.values for node, found in self.nodes.items()},
            "differences": self.differences,
            "findings": self.findings,
            "damage": self.damage,
            "speed": {"real_time_factor": factor, "seconds": self.seconds},
        }


def replay_page(result: Replay) -> Page:
    """Return the page of a replay: a line for each figure, findings and damage below."""
    rows = [
        (node if i == 0 else "", name, value)
        for node, found in result.nodes.items()
        for i, (name, value) in enumerate(found.rows)
    ]
    lines = [
        Text([f"{heading}: {line}" for line in lines], style=colour)
        for heading, colour, lines in (
            ("Damage", "warn", result.damage),
            ("Finding", "warn", result.findings),
            ("Difference", "bad", result.differences),
        )
    ]
    count = len(result.differences)
    factor = result.duration_s / max(result.seconds, 1e-9)
    speed = f"{result.duration_s:.1f} s recorded, {factor:.0f} times real time"
    return Page(
        title=f"Replay of {result.bag.name}",
        eyebrow="Replay",
        headline=f"Replay of {result.bag}",
        verdict=f"{count} difference{'s' * (count > 1)}" if count else "no difference",
        verdict_style="bad" if count else "good",
        summary="" if count else "Nothing differs by more than the tolerances.",
        sections=[
            Section("", [Table(("node", "figure", "value"), rows)]),
            Section("", lines),
            Section("", [Text([speed])]),
        ],
        data=result.as_mapping(),
    )


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
        contacts_ns = _contacts(recording)
        for node in inputs.nodes:
            published, counted = through_core(inputs, node)
            recorded = {
                topic: inputs.stream(topic)
                for topic in published
                if (there := recording.topics.get(topic)) is not None
                and there.typename == TOPICS[topic].typename
            }
            found = compare_streams(node, recorded, published, result.begin_ns, contacts_ns)
            _add_counts(found, counted)
            result.nodes[node] = found
            result.published |= published
            if node == "detector" and recorded.get(DETECTOR_STATUS.name, NOTHING)[1]:
                _check_statistic(inputs, recorded[DETECTOR_STATUS.name], found, result.begin_ns)
        result.findings = inputs.findings
        result.damage = recording.damage
    result.seconds = time.perf_counter() - began
    return result


def _check_statistic(
    inputs: Inputs, recorded: Stream, found: NodeComparison, begin_ns: int
) -> None:
    """Compare the recorded statistic with that of filterpy's own filter; add what differs.

    Of several poses with one stamp, it is not known which one a status belongs to.
    """
    from tombo_collision.reference_filter import reference_statistics  # filterpy takes 0.5 s

    filtered = reference_statistics(*inputs.stream(MOCAP_POSE.name), inputs.scenario.detector)
    statistics = (
        pd.Series([status.statistic for status in recorded[1]], [s.stamp_ns for s in recorded[1]]),
        pd.Series(filtered, inputs.poses.stamp_ns),
    )
    unique = [series[~series.index.duplicated(keep=False)] for series in statistics]
    both = pd.concat(unique, axis=1, join="inner", keys=("recorded", "filterpy"))
    near = (both["recorded"] - both["filterpy"]).abs() <= _STATISTIC_ERROR * both["filterpy"].clip(
        1
    )
    differing = both[~near]
    found.values["filterpy"] = {"compared": len(both), "differing": len(differing)}
    for stamp_ns, (value, reference) in differing[:1].iterrows():
        inputs.findings.append(
            f"the recorded statistic of {len(differing)} of {len(both)} poses is not that of"
            f" filterpy's filter, first {value:.9g} for {reference:.9g} at"
            f" {1e-9 * (stamp_ns - begin_ns):.3f} s: other parameters of the detector, poses"
            " that were not recorded, or another detector"
        )


def _add_counts(found: NodeComparison, counted: Mapping[str, Any]) -> None:
    """Add how many poses and events a node got, and how many it refused."""
    found.values |= counted
    for kind in ("events", "poses"):
        refused = counted.get(f"{kind}_refused") or {}
        words = [f"{count} {why}" for why, count in refused.items()]
        number = [str(counted[kind])] if kind in counted else []
        if number or words:
            text = ", ".join([*number, *([f"refused: {', '.join(words)}"] if words else [])])
            found.rows.insert(0, (kind, text))


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
    missing = {name: [t for t in needed_inputs(name) if t not in there] for name in asked}
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
    wanted = {topic for name in nodes for topic in (*NODES[name].inputs, *NODES[name].outputs)}
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

"""Feeds the pure cores, one node after the other, each with what was recorded."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from tombo_bag.columns import ColumnTable
from tombo_bag.recording import Recording
from tombo_bag.topics import (
    COLLISION_EVENT,
    DETECTOR_STATUS,
    ESTIMATOR_STATUS,
    IMU,
    MISSION_SETPOINT,
    MISSION_STATUS,
    ODOMETRY,
    REACTION_STATUS,
    SETPOINT,
)
from tombo_flight.replay.controller_replay import replay_controller
from tombo_flight.replay.detector_replay import replay_detector
from tombo_flight.replay.estimator_replay import replay_estimator
from tombo_flight.replay.mission_replay import replay_mission
from tombo_flight.replay.outputs import Outputs
from tombo_flight.replay.poses import PoseTrack
from tombo_flight.replay.reaction_replay import replay_reaction
from tombo_flight.scenario import Scenario


@dataclass
class Inputs:
    """A recording made ready: which nodes can be fed, and with what."""

    recording: Recording
    scenario: Scenario
    nodes: tuple[str, ...]
    poses: PoseTrack
    """Empty if there are none."""
    findings: list[str] = field(default_factory=list)
    """What the replay finds on its way."""

    def table(self, topic: str) -> ColumnTable:
        """Return a topic's columns."""
        return self.recording.columns(topic)

    def has(self, topic: str) -> bool:
        """Return whether there is at least one message of a topic."""
        streams = self.recording.topics
        return topic in streams and streams[topic].count > 0


def through_cores(inputs: Inputs, recorded: Outputs) -> tuple[Outputs, dict[str, dict[str, Any]]]:
    """Return what the nodes say, and figures by node."""
    cores = _Cores(inputs, recorded)
    told: dict[str, dict[str, Any]] = {}
    for node in inputs.nodes:
        began = time.perf_counter()
        told[node] = getattr(cores, node)()
        told[node]["seconds"] = time.perf_counter() - began
    return cores.said, told


class _Cores:
    """A method for each node of `plan.NODES`: adds what it says to `said`, returns figures."""

    def __init__(self, inputs: Inputs, recorded: Outputs) -> None:
        self.inputs = inputs
        self.recorded = recorded
        self.said = Outputs()

    def detector(self) -> dict[str, Any]:
        found, refused = self._detections
        self.said.events = found.events
        self.said.series.update(found.series)
        return {"poses": len(self.inputs.poses.stamp_ns), "poses_refused": refused}

    def estimator(self) -> dict[str, Any]:
        inputs = self.inputs
        found = replay_estimator(
            inputs.poses,
            inputs.table(IMU.name),
            inputs.table(MISSION_STATUS.name) if inputs.has(MISSION_STATUS.name) else None,
            inputs.scenario.estimator,
            inputs.scenario.vehicle,
        )
        self.said.series.update(found.series())
        return {"poses": found.poses, "poses_refused": found.rejected}

    def mission(self) -> dict[str, Any]:
        inputs = self.inputs

        def arrivals(topic: str, clock: str = "log_time_ns") -> Any:
            return inputs.table(topic)[clock] if inputs.has(topic) else None

        answers, ticks = arrivals(SETPOINT.name), arrivals(MISSION_SETPOINT.name, "stamp_ns")
        known = inputs.has(REACTION_STATUS.name)
        self.said.series.update(
            replay_mission(
                inputs.table(ODOMETRY.name),
                inputs.table(REACTION_STATUS.name) if known else None,
                np.zeros(0, np.int64) if answers is None else answers,
                ticks,
                inputs.scenario.mission,
                inputs.scenario.vehicle.leg_height,
            )
        )
        return {}

    def reaction(self) -> dict[str, Any]:
        inputs, topics = self.inputs, self.inputs.recording.topics
        events, status = self.recorded.events, None
        if DETECTOR_STATUS.name in topics:
            status = inputs.table(DETECTOR_STATUS.name)["log_time_ns"]
        elif len(inputs.poses.stamp_ns):
            inputs.findings.append(
                f"reaction: no {DETECTOR_STATUS.name} in the bag; the detector counts as alive"
            )
            status = inputs.poses.arrival_ns
        if events is None and len(inputs.poses.stamp_ns):
            inputs.findings.append(
                f"reaction: no {COLLISION_EVENT.name} in the bag; it gets the replayed detector's"
            )
            events = self._detections[0].events
        found = replay_reaction(
            inputs.table(MISSION_SETPOINT.name),
            inputs.table(ODOMETRY.name),
            inputs.poses.arrival_ns,
            np.zeros(0, np.int64) if status is None else status,
            events or [],
            inputs.scenario.reaction,
        )
        self.said.series.update(found.series)
        return {"events_refused": found.refused}

    def controller(self) -> dict[str, Any]:
        self.said.series["rotor_command"] = replay_controller(
            self.inputs.table(IMU.name),
            self.inputs.table(ODOMETRY.name),
            self.inputs.table(SETPOINT.name),
            self.inputs.table(ESTIMATOR_STATUS.name),
            self.inputs.scenario,
        )
        return {}

    @cached_property
    def _detections(self) -> tuple[Outputs, dict[str, int]]:
        return replay_detector(self.inputs.poses, self.inputs.scenario.detector)

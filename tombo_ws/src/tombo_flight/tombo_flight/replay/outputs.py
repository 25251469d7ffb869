"""Outputs of nodes, recorded or replayed, in a form that can be compared; which node has which."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tombo_bag.columns import ColumnTable
from tombo_bag.message_codec import fields_of, messages_of
from tombo_bag.recording import Recording
from tombo_bag.topics import (
    COLLISION_EVENT,
    CONTACT_EVENT,
    DETECTOR_STATUS,
    GOAL_POSE,
    MISSION_STATUS,
    MOCAP_POSE,
    REACTION_STATUS,
    SETPOINT,
    TOPICS,
)
from tombo_collision.detector_core import DetectorCore
from tombo_collision.reaction_core import ReactionCore
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator_core import EstimatorCore
from tombo_control.mission_core import MissionCore
from tombo_dynamics.arrays import Array, Times
from tombo_dynamics.core import Core
from tombo_dynamics.messages import CollisionEvent, Trigger
from tombo_sim.wiring import CORES


@dataclass(frozen=True)
class DetectedEvent:
    """A detected collision."""

    message: CollisionEvent
    known_ns: int
    """When it was known: arrival of the pose that triggered, or log time of the recorded event."""

    @property
    def stamp_ns(self) -> int:
        """Capture time of the pose that triggered."""
        return self.message.stamp_ns

    @property
    def trigger(self) -> str:
        """Name of the trigger; an unknown one is its number."""
        number = int(self.message.trigger)
        return Trigger(number).name.lower() if number in set(Trigger) else str(number)


@dataclass(frozen=True)
class OutputSeries:
    """A quantity over time, by the header's stamp: N stamps and (N, k) values."""

    stamp_ns: Times
    values: Array


@dataclass
class Outputs:
    """Outputs: events in order of time, series by name."""

    events: list[DetectedEvent] | None = None
    """None: nobody recorded events (no topic); a list without elements: there were none."""
    series: dict[str, OutputSeries] = field(default_factory=dict)


@dataclass(frozen=True)
class SeriesField:
    """Where a series comes from: a topic, a field of its dataclass, numbers of that field."""

    topic: str
    field: str
    width: int


SERIES: dict[str, SeriesField] = {
    "statistic": SeriesField("/detector/status", "statistic", 1),
    "setpoint": SeriesField("/setpoint", "position", 3),
    "mission_setpoint": SeriesField("/mission/setpoint", "position", 3),
    "phase": SeriesField("/mission/status", "phase", 1),
    "reaction_state": SeriesField("/reaction/status", "state", 1),
    "x_r": SeriesField("/reaction/status", "x_r", 3),
    "odometry_position": SeriesField("/odometry", "position", 3),
    "odometry_attitude": SeriesField("/odometry", "attitude", 4),
    "odometry_velocity": SeriesField("/odometry", "velocity", 3),
    "rotor_command": SeriesField("/rotor_command", "speed", 4),
}
"""Series by name."""
EVENTS = "/collision_event"


def read_outputs(recording: Recording, names: Sequence[str]) -> Outputs:
    """Read what a recording holds of some series, and of the events if `events` is named."""
    topics = recording.topics
    found = Outputs()
    if "events" in names and EVENTS in topics:
        found.events = read_events(recording.columns(EVENTS))
    for name in names:
        source = SERIES.get(name)
        if source is not None and source.topic in topics and topics[source.topic].count:
            typename = TOPICS[source.topic].typename
            if topics[source.topic].typename == typename:
                fields = fields_of(typename, recording.columns(source.topic))
                values = fields[source.field].astype(np.float64)
                found.series[name] = OutputSeries(
                    fields["stamp_ns"], values.reshape(-1, source.width)
                )
    return found


def read_events(table: ColumnTable) -> list[DetectedEvent]:
    """Read messages of tombo_msgs/CollisionEvent."""
    if "trigger" not in table:
        return []
    messages = messages_of(TOPICS[EVENTS].typename, table)
    return list(map(DetectedEvent, messages, table["log_time_ns"].tolist()))


def series_of(messages: Sequence[Any], source: SeriesField) -> OutputSeries:
    """Return a series from the messages of its topic."""
    values = np.array([getattr(m, source.field) for m in messages], np.float64)
    stamps = np.array([m.stamp_ns for m in messages], np.int64)
    return OutputSeries(stamps, values.reshape(-1, source.width))


@dataclass(frozen=True)
class NodePlan:
    """How a node is replayed."""

    core: type[Core]
    compared_outputs: tuple[str, ...]
    """Names of `outputs.SERIES`, or `events`."""
    optional_inputs: tuple[str, ...] = ()
    """Topics that are fed if they are there."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Topics without which it can't be replayed."""
        return tuple(t for t in self.core.inputs if t not in self.optional_inputs)


_PLANS = {
    plan.core: plan
    for plan in (
        NodePlan(DetectorCore, ("events", "statistic")),
        NodePlan(
            MissionCore,
            ("mission_setpoint", "phase"),
            (REACTION_STATUS.name, SETPOINT.name, GOAL_POSE.name),
        ),
        NodePlan(
            ReactionCore,
            ("events", "setpoint", "x_r"),
            (MOCAP_POSE.name, DETECTOR_STATUS.name, COLLISION_EVENT.name, CONTACT_EVENT.name),
        ),
        NodePlan(
            EstimatorCore,
            ("odometry_position", "odometry_attitude", "odometry_velocity"),
            (MISSION_STATUS.name,),
        ),
        NodePlan(ControllerCore, ("rotor_command",)),
    )
}
NODES = {core.name: _PLANS.get(core, NodePlan(core, ())) for core in CORES}
"""Those of the wiring; of a core without a plan nothing is compared."""


def outputs_of(nodes: Iterable[str]) -> list[str]:
    """Return the names of all that is compared of some nodes."""
    return [name for node in nodes for name in NODES[node].compared_outputs]

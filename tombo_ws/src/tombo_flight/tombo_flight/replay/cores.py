"""Feeds the cores from a recording: the inputs of its node, in the order of arrival.

Parameters and the clock of the nodes are those of the recording.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.formats.bag_files import TopicSummary
from tombo_bag.message_codec import messages_of
from tombo_bag.recording import Recording
from tombo_bag.topics import (
    COLLISION_EVENT,
    DETECTOR_STATUS,
    IMU,
    MISSION_SETPOINT,
    MOCAP_POSE,
    ODOMETRY,
    SETPOINT,
    TOPICS,
)
from tombo_dynamics.arrays import Times
from tombo_dynamics.core import Core, CoreRunner
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import DetectorStatus, Pose, neutral
from tombo_dynamics.time_base import TICK_NS
from tombo_flight.recorded_flight import scenario_of_metadata
from tombo_flight.replay.compared import NODES, NOTHING, Stream
from tombo_flight.replay.poses import PoseTrack
from tombo_flight.scenario import Scenario, as_mapping, scenario_over
from tombo_flight.wiring import core_of
from tombo_sim.wiring import CORES

Published = list[tuple[int, str, Any]]
"""Time, topic and message of all that a core has published."""
_PUBLISHED_BY_CORES = {topic for core in CORES for topic in core.outputs}
_FEWEST_STEPS, _STEPS_A_MESSAGE = 10_000, 100
"""A core is stepped some twenty times at most for each message that it gets."""
CLOCK_TOPICS = (MISSION_SETPOINT.name, SETPOINT.name)
"""Topics whose stamps are the nodes' now."""
_APART_NS = 250_000_000
"""Nearer clocks are one clock."""


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


@dataclass
class Inputs:
    """A prepared recording: which nodes can be fed, and their inputs."""

    recording: Recording
    scenario: Scenario
    nodes: tuple[str, ...]
    poses: PoseTrack
    """Empty if there are none."""
    findings: list[str] = field(default_factory=list)
    """Findings of the replay."""

    def has(self, topic: str) -> bool:
        """Return whether there is at least one message of a topic."""
        streams = self.recording.topics
        return topic in streams and streams[topic].count > 0

    def is_paced_by_ticks(self) -> bool:
        """Return whether log times are those of publication in a simulated tick.

        A message of one tick is there for other cores in the next (`tombo_dynamics.core`).
        """
        if not self.has(ODOMETRY.name):
            return False
        table = self.recording.columns(ODOMETRY.name)
        times: Times = table["log_time_ns"]
        return not (times % TICK_NS).any() and np.array_equal(times, table["stamp_ns"])

    def stream(self, topic: str) -> Stream:
        """Return the recorded messages of a topic.

        Raises:
            InputError: it has another type.
        """
        if topic == MOCAP_POSE.name:
            track = self.poses
            rows = zip(
                track.stamp_ns.tolist(),
                track.frame.tolist(),
                track.position,
                track.attitude,
                strict=True,
            )
            return track.arrival_ns, [Pose(*row) for row in rows]
        if not self.has(topic):
            return NOTHING
        found, wanted = self.recording.topics[topic].typename, TOPICS[topic].typename
        if found != wanted:
            raise InputError(f"{topic} has type {found}; accepted: {wanted}")
        table = self.recording.columns(topic)
        return table["log_time_ns"], messages_of(wanted, table)


def through_core(inputs: Inputs, node: str) -> tuple[dict[str, Stream], dict[str, Any]]:
    """Return the messages of a node's core by topic, and its counters."""
    core = core_of(NODES[node], inputs.scenario)
    streams = {topic: inputs.stream(topic) for topic in core.inputs}
    if DETECTOR_STATUS.name in streams and not inputs.has(DETECTOR_STATUS.name):
        arrivals = inputs.poses.arrival_ns
        alive = [neutral(DetectorStatus, int(now)) for now in arrivals]
        streams[DETECTOR_STATUS.name] = arrivals, alive
        inputs.findings.append(f"{node}: no {DETECTOR_STATUS.name} in the bag; taken for alive")
    without_events = COLLISION_EVENT.name not in inputs.recording.topics
    if COLLISION_EVENT.name in streams and without_events and len(inputs.poses.stamp_ns):
        streams[COLLISION_EVENT.name] = through_core(inputs, "detector")[0][COLLISION_EVENT.name]
        inputs.findings.append(
            f"{node}: no {COLLISION_EVENT.name} in the bag; it gets the replayed detector's"
        )
    if inputs.is_paced_by_ticks():
        for topic in _PUBLISHED_BY_CORES & set(streams):
            times, messages = streams[topic]
            streams[topic] = times + TICK_NS, messages
    published, reported = replay_core(core, streams, _steps(core, inputs, streams))
    return {topic: _of_topic(published, topic) for topic in core.outputs}, _figures(core, reported)


def _of_topic(published: Published, topic: str) -> Stream:
    there = [(now, message) for now, name, message in published if name == topic]
    return np.array([now for now, _ in there], np.int64), [message for _, message in there]


def replay_core(
    core: Core, streams: dict[str, Stream], steps: Times
) -> tuple[Published, Counter[str]]:
    """Feed a core all messages in order of arrival, as the node that hosts it would.

    What arrives at one time is handed over before one step, as in `run_wiring`.

    Args:
        core: new.
        streams: of its inputs, in their order.
        steps: times at which it is stepped besides.

    Returns:
        its messages, and the count of each report.
    """
    topics = list(streams)
    published: Published = []
    reported: Counter[str] = Counter()
    runner = CoreRunner(core)
    clocks = [*(times for times, _ in streams.values()), steps]
    arrivals = sorted(
        (now, stream, row)
        for stream, times in enumerate(clocks)
        for row, now in enumerate(times.tolist())
    )
    for now, entries in groupby(arrivals, key=itemgetter(0)):
        due = core.steps_on_messages
        for _, stream, row in entries:
            if stream < len(topics):
                runner.take(topics[stream], streams[topics[stream]][1][row])
            else:
                due = True
        published += [(now, topic, message) for topic, message in runner.run(now, due)]
        reported.update(key for key, _ in core.health.take_events())
    return published, reported


def _steps(core: Core, inputs: Inputs, streams: dict[str, Stream]) -> Times:
    """Return when a core is stepped besides: as recorded where that tells, else by its period.

    In simulated ticks it was stepped by its period also before it had anything to publish.
    """
    topic = next(iter(core.outputs))
    if not core.steps_on_messages and inputs.has(topic):
        stamps: Times = inputs.recording.columns(topic)["stamp_ns"]
        if not inputs.is_paced_by_ticks():
            return stamps
        began = min(int(times[0]) for times, _ in streams.values() if len(times))
        silent = np.arange(-(-began // core.period_ns), int(stamps[0]) // core.period_ns)
        return np.concatenate((silent * core.period_ns, stamps))
    ends = [t for times, _ in streams.values() if len(times) for t in (times[0], times[-1])]
    if not ends:
        return np.zeros(0, np.int64)
    first, last = int(min(ends)) // core.period_ns, int(max(ends)) // core.period_ns
    messages = sum(len(times) for times, _ in streams.values())
    if last - first > _FEWEST_STEPS + _STEPS_A_MESSAGE * messages:
        raise InputError(
            f"'{inputs.recording.path}' has {messages} messages over "
            f"{1e-9 * (max(ends) - min(ends)):.0f} s; accepted: the log times of one flight"
        )
    return np.arange(first + 1, last + 2, dtype=np.int64) * core.period_ns


def _figures(core: Core, reported: Counter[str]) -> dict[str, Any]:
    """Return the counters of a core."""
    figures = {key: core.health.values[key] for key in ("poses",) if key in core.health.values}
    for kind in ("pose", "event"):
        refused = {
            key.removeprefix(f"{kind}_"): count
            for key, count in reported.items()
            if key.startswith(f"{kind}_")
        }
        if f"{kind}s" in figures or refused:
            figures[f"{kind}s_refused"] = refused
    return figures

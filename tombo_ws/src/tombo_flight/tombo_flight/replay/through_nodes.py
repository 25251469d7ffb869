"""Feeds the real nodes over DDS: starts them, plays the recording to them, ends them."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight_time import stamp
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_bag.topics import (
    DETECTOR_STATUS,
    IMU,
    MISSION_SETPOINT,
    MOCAP_POSE,
    ODOMETRY,
    ROTOR_COMMAND,
    SETPOINT,
    TOPICS,
)
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.replay.cores import Inputs
from tombo_flight.replay.outputs import EVENTS, NODES, SERIES, Outputs, outputs_of, read_outputs
from tombo_flight.replay.recorded import PoseTrack
from tombo_flight.suite.nodes import free_domain, node_environment, node_program, udp_ports
from tombo_flight.suite.parameter_yaml import parameter_yaml, suite_parameters
from tombo_flight.suite.supervisor import ProcessExit, Program, Supervisor, json_object

PLAYER = "replay"
PLAYER_MODULE = "tombo_flight.replay.replay_node"
DISCOVERY_TIMEOUT_S = 40.0
"""The nodes must have found each other after so long."""
_LOOK_S = 0.2
_REPLAY_PREFIX = "/replayed"
"""Before the names of topics on which the nodes answer."""
_ANSWERS: dict[str, tuple[str, str, int, int, bool]] = {
    "detector": (MOCAP_POSE.name, DETECTOR_STATUS.name, 1, 3, True),
    "mission": (ODOMETRY.name, MISSION_SETPOINT.name, 0, 50, True),
    "reaction": (MISSION_SETPOINT.name, SETPOINT.name, 1, 3, True),
    "estimator": (IMU.name, ODOMETRY.name, 4, 40, False),
    "controller": (IMU.name, ROTOR_COMMAND.name, 1, 10, True),
}
"""Node → what it is asked, what it answers, and how far it may be behind (see `replay_node`)."""


class Interrupted(Exception):
    """The replay was stopped."""


class ThroughNodes:
    """Takes the place of `cores.through_cores`.

    Each node is fed what was recorded, not what another one says now: what it says goes to a topic
    of another name, unless nobody recorded that topic.
    """

    def __init__(
        self,
        speed: float,
        on_progress: ProgressCallback = no_progress,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self._speed = speed
        self._tell = on_progress
        self._stop = stop

    def __call__(
        self, inputs: Inputs, recorded: Outputs
    ) -> tuple[Outputs, dict[str, dict[str, Any]]]:
        """Return the outputs of the nodes, and figures by node.

        Raises:
            InputError: a node or the player ended before the end, or they did not meet.
            Interrupted: `stop` said so; all nodes have ended.
        """
        began = time.perf_counter()
        plan = _PlayedTopics(inputs)
        with tempfile.TemporaryDirectory(prefix="tombo-replay-") as name:
            folder = Path(name)
            plan.write_inputs(folder / "inputs.mcap")
            programs = plan.programs(folder, self._speed)
            environment = node_environment(
                os.environ, folder / "ros", free_domain(os.getpid(), udp_ports())
            )
            with Supervisor(programs, folder / "log", environment) as supervisor:
                done = self._follow(supervisor)
            with Recording(folder / "outputs.mcap") as answers:
                names = outputs_of(inputs.nodes)
                found = read_outputs(answers, names)
        for name in names:  # no output is a valid answer
            if name == "events":
                found.events = found.events or []
            else:
                found.series.setdefault(name, SERIES[name].empty())
        metrics = {"seconds": time.perf_counter() - began, "dds": done}
        reported = {node: dict(metrics) for node in inputs.nodes}
        for node in {"detector", "estimator"} & set(inputs.nodes):
            reported[node]["poses"] = len(inputs.poses.stamp_ns)
        return found, reported

    def _follow(self, supervisor: Supervisor) -> dict[str, Any]:
        """Watch until the player is through."""
        missing: list[str] = []
        playing = False
        began = time.monotonic()
        self._tell("starting the nodes", 0.0)
        while True:
            poll = supervisor.poll(_LOOK_S)
            for _, line in poll.lines:
                said = json_object(line)
                if "done" in said:
                    return dict(said["done"])
                missing = said.get("missing", missing)
                playing = playing or "played" in said or said.get("missing") == []
                if "played" in said:
                    self._tell("replaying", said["played"])
            if poll.ended:
                raise InputError(_exit_text(poll.ended))
            if self._stop():
                raise Interrupted
            if not playing and time.monotonic() - began > DISCOVERY_TIMEOUT_S:
                raise InputError(
                    f"--dds: after {DISCOVERY_TIMEOUT_S:.0f} s still nobody at "
                    f"{', '.join(missing)}; "
                    "accepted: nodes that find each other (another ROS_DOMAIN_ID, or a firewall?)"
                )


def _exit_text(ended: Sequence[ProcessExit]) -> str:
    first = ended[0]
    words = f": {first.last_log_lines[-1]}" if first.last_log_lines else ""
    return f"--dds: {first.name} ended before the replay did ({first.exit_text}){words}"


class _PlayedTopics:
    """Which topics are played to the nodes, and the topics of their answers."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        wanted = [
            topic
            for node in inputs.nodes
            for topic in (*NODES[node].inputs, *NODES[node].optional_inputs)
        ]
        live = {topic for node in inputs.nodes for topic in NODES[node].core.outputs}
        self.detector_status_missing = (
            "reaction" in inputs.nodes
            and not inputs.has(DETECTOR_STATUS.name)
            and DETECTOR_STATUS.name not in live
            and len(inputs.poses.stamp_ns) > 0
        )
        self.listeners = {
            topic: wanted.count(topic) for topic in dict.fromkeys(wanted) if self._there(topic)
        }
        names = outputs_of(inputs.nodes)
        compared = {EVENTS if name == "events" else SERIES[name].topic for name in names}
        self.said = {topic: self._name(topic) for topic in sorted(live & compared)}

    def _there(self, topic: str) -> bool:
        if topic == MOCAP_POSE.name:
            return len(self.inputs.poses.stamp_ns) > 0
        return self.inputs.has(topic) or (
            topic == DETECTOR_STATUS.name and self.detector_status_missing
        )

    def _name(self, topic: str) -> str:
        recorded = topic in self.inputs.recording.topics
        return f"{_REPLAY_PREFIX}{topic}" if recorded else topic

    def programs(self, folder: Path, speed: float) -> list[Program]:
        """Return the nodes and the player, whose files are written into a folder."""
        nodes = self.inputs.nodes
        parameters = suite_parameters(self.inputs.scenario, 0)
        chosen = {node: {**parameters[node], "use_sim_time": True} for node in nodes}
        file = folder / "parameters.yaml"
        file.write_text(parameter_yaml(chosen), encoding="utf-8")
        job = {
            "inputs": str(folder / "inputs.mcap"),
            "outputs": str(folder / "outputs.mcap"),
            "speed": speed,
            "listeners": self.listeners,
            "topics": self.said,
            "answers": [_ANSWERS[node] for node in nodes if node in _ANSWERS],
        }
        (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
        player = (sys.executable, "-m", PLAYER_MODULE, str(folder / "job.json"))
        return [*(self._program(node, file) for node in nodes), Program(PLAYER, player, True)]

    def _program(self, node: str, file: Path) -> Program:
        plain = node_program(node, [file])
        moved = {topic: self._name(topic) for topic in NODES[node].core.outputs}
        rules = [
            word
            for topic, name in moved.items()
            if name != topic
            for word in ("-r", f"{topic.lstrip('/')}:={name}")
        ]
        return Program(plain.name, (*plain.command, *rules), plain.capture_stdout)

    def write_inputs(self, path: Path) -> None:
        """Write what is played: log times by the nodes' clock, poses as PoseStamped."""
        recording, poses = self.inputs.recording, self.inputs.poses
        with McapSink(path) as sink:
            parts = []
            for topic in self.listeners:
                spec = TOPICS[topic]
                channel = sink.add_channel(topic, spec.typename, spec.qos)
                if topic == MOCAP_POSE.name:
                    parts.append(Columns(channel, poses.arrival_ns, _encoded(poses)))
                elif topic == DETECTOR_STATUS.name and self.detector_status_missing:
                    sign = encode(DETECTOR_STATUS.typename, {"header": {"frame_id": FRAME_MAP}})
                    times = poses.arrival_ns
                    parts.append(Columns(channel, times, [sign] * len(times)))
                elif recording.topics[topic].typename != spec.typename:
                    raise InputError(
                        f"{topic} has type {recording.topics[topic].typename}; accepted with "
                        f"--dds: {spec.typename}"
                    )
                else:
                    raw = recording.messages(topic)
                    times = recording.on_clock(raw.log_times_ns)
                    parts.append(Columns(channel, times, raw.messages))
            sink.write_columns(*parts)


def _encoded(poses: PoseTrack) -> list[bytes]:
    rows = zip(
        np.maximum(poses.stamp_ns, 0).tolist(),
        poses.frame.tolist(),
        poses.position.tolist(),
        poses.attitude.tolist(),
        strict=True,
    )
    return [
        encode(
            MOCAP_POSE.typename,
            {
                "header": {"stamp": stamp(time_ns), "frame_id": frame},
                "pose": {
                    "position": dict(zip("xyz", position, strict=True)),
                    "orientation": dict(zip("xyzw", attitude, strict=True)),
                },
            },
        )
        for time_ns, frame, position, attitude in rows
    ]

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
from tombo_bag.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_bag.topics import MOCAP_POSE, TOPICS
from tombo_bringup.replay.cores import Inputs
from tombo_bringup.replay.outputs import EVENTS, SERIES, Outputs, read_outputs
from tombo_bringup.replay.plan import NODES, said_by
from tombo_bringup.replay.poses import PoseTrack
from tombo_bringup.suite.domain import free_domain, udp_ports
from tombo_bringup.suite.nodes import node_environment, node_program
from tombo_bringup.suite.parameter_yaml import parameter_yaml, suite_parameters
from tombo_bringup.suite.supervisor import Ended, Program, Supervisor
from tombo_dynamics.errors import InputError

PLAYER = "replay"
PLAYER_MODULE = "tombo_bringup.replay_node"
MEETING_S = 40.0
"""The nodes must have found each other after so long."""
_LOOK_S = 0.2

Tell = Callable[[str, float], None]
"""Told what is being done and how far it is: a stage and a share from 0 to 1."""


def _silent(stage: str, share: float) -> None:
    return


class Interrupted(Exception):
    """The replay was to be stopped."""


class ThroughNodes:
    """Takes the place of `cores.through_cores`. What one of the nodes says is not played."""

    def __init__(
        self, speed: float, tell: Tell = _silent, stop: Callable[[], bool] = lambda: False
    ) -> None:
        self._speed = speed
        self._tell = tell
        self._stop = stop

    def __call__(
        self, inputs: Inputs, recorded: Outputs
    ) -> tuple[Outputs, dict[str, dict[str, Any]]]:
        """Return what the nodes say, and figures by node.

        Raises:
            InputError: a node or the player ended before the end, or they did not meet.
            Interrupted: `stop` said so; all nodes have ended.
        """
        began = time.perf_counter()
        played = _played(inputs)
        said = _topics_said(inputs.nodes)
        with tempfile.TemporaryDirectory(prefix="tombo-replay-") as name:
            folder = Path(name)
            _write_inputs(folder / "inputs.mcap", inputs, played)
            programs = _programs(folder, inputs, played, said, self._speed)
            environment = node_environment(
                os.environ, folder / "ros", free_domain(os.getpid(), udp_ports())
            )
            with Supervisor(programs, folder / "log", environment) as supervisor:
                done = self._follow(supervisor)
            with Recording(folder / "outputs.mcap") as answers:
                names = said_by(inputs.nodes)
                found = read_outputs(answers, names)
        for name in names:  # silence is an answer too
            if name == "events":
                found.events = found.events or []
            else:
                found.series.setdefault(name, SERIES[name].empty())
        figures = {"seconds": time.perf_counter() - began, "dds": done}
        told = {node: dict(figures) for node in inputs.nodes}
        for node in {"detector", "estimator"} & set(inputs.nodes):
            told[node]["poses"] = len(inputs.poses.stamp_ns)
        return found, told

    def _follow(self, supervisor: Supervisor) -> dict[str, Any]:
        """Watch until the player is through."""
        missing: list[str] = []
        playing = False
        began = time.monotonic()
        self._tell("starting the nodes", 0.0)
        while True:
            look = supervisor.look(_LOOK_S)
            for _, line in look.heard:
                said = _object(line)
                if "done" in said:
                    return dict(said["done"])
                missing = said.get("missing", missing)
                playing = playing or "played" in said or said.get("missing") == []
                if "played" in said:
                    self._tell("replaying", said["played"])
            if look.ended:
                raise InputError(_obituary(look.ended))
            if self._stop():
                raise Interrupted
            if not playing and time.monotonic() - began > MEETING_S:
                raise InputError(
                    f"--dds: after {MEETING_S:.0f} s still nobody at {', '.join(missing)}; "
                    "accepted: nodes that find each other (another ROS_DOMAIN_ID, or a firewall?)"
                )


def _object(line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _obituary(ended: Sequence[Ended]) -> str:
    one = ended[0]
    words = f": {one.last_words[-1]}" if one.last_words else ""
    return f"--dds: {one.name} ended before the replay did ({one.how}){words}"


def _topics_said(nodes: Sequence[str]) -> list[str]:
    """Return the topics on which the nodes answer."""
    names = said_by(nodes)
    topics = [EVENTS if name == "events" else SERIES[name].topic for name in names]
    if "detector" not in nodes:  # the reaction is compared with events, but doesn't say them
        topics = [topic for topic in topics if topic != EVENTS]
    return list(dict.fromkeys(topics))


def _played(inputs: Inputs) -> dict[str, int]:
    """Return the topics to be played, and how many of the nodes listen to each."""
    listeners: dict[str, int] = {}
    for node in inputs.nodes:
        plan = NODES[node]
        for topic in (*plan.inputs, *plan.helps):
            listeners[topic] = listeners.get(topic, 0) + 1
    own = {topic for node in inputs.nodes for topic in NODES[node].topics_said}
    return {
        topic: count
        for topic, count in listeners.items()
        if topic not in own
        and (len(inputs.poses.stamp_ns) if topic == MOCAP_POSE.name else inputs.has(topic))
    }


def _programs(
    folder: Path, inputs: Inputs, played: dict[str, int], said: Sequence[str], speed: float
) -> list[Program]:
    parameters = suite_parameters(inputs.scenario, 0)
    for node in inputs.nodes:
        parameters[node] = {**parameters[node], "use_sim_time": True}
    file = folder / "parameters.yaml"
    file.write_text(parameter_yaml({n: parameters[n] for n in inputs.nodes}), encoding="utf-8")
    arguments = (
        str(folder / "inputs.mcap"),
        str(folder / "outputs.mcap"),
        str(speed),
        json.dumps(played),
        *said,
    )
    player = Program(PLAYER, (sys.executable, "-m", PLAYER_MODULE, *arguments), listened=True)
    return [*(node_program(node, [file]) for node in inputs.nodes), player]


def _write_inputs(path: Path, inputs: Inputs, played: dict[str, int]) -> None:
    """Write what is to be played: log times by the nodes' clock, poses as PoseStamped in map."""
    recording = inputs.recording
    with McapSink(path, compression="none") as sink:
        parts = []
        for topic in played:
            spec = TOPICS[topic]
            channel = sink.add_channel(topic, spec.typename, spec.qos)
            if topic == MOCAP_POSE.name:
                parts.append(Columns(channel, inputs.poses.arrival_ns, _encoded(inputs.poses)))
                continue
            if recording.topics[topic].typename != spec.typename:
                raise InputError(
                    f"{topic} has type {recording.topics[topic].typename}; accepted with --dds: "
                    f"{spec.typename}"
                )
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

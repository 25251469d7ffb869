"""Flies with six cores: FOLDER WAY...; writes what they publish.

Ways: `compiled`, `batch`, `replay` (of the compiled flight's recording), `parameters`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tombo_bag.flight_topics import write_flight
from tombo_bag.formats.mcap_sink import McapSink
from tombo_bag.message_codec import messages_of
from tombo_bag.recording import Recording
from tombo_bag.topics import TOPICS
from tombo_dynamics.time_base import EPOCH_NS, TICK_S
from tombo_flight.flight import fly_scenario
from tombo_flight.replay.cores import Inputs, replayed
from tombo_flight.replay.recorded import PoseTrack
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.parameter_yaml import parameter_yaml, suite_parameters
from tombo_flight.training import Episodes

SEED, WIND_EAST, TOPIC = 3, 1.5, "/wind"
SCENARIO = load_scenario(
    "paper_collision",
    (
        "mission.takeoff_time=0.2", "mission.climb_speed=1.2", "mission.approach_time=3.5",
        "obstacle.x=1.4", "duration=6", f"effects.steady_wind.east={WIND_EAST}",
        "effects.linear_rotor_drag.d_xy=0.3",
    ),
)  # fmt: skip


def numbers(messages: Any) -> Any:
    """Return all there is of messages of odometry."""
    return np.array([
        [m.stamp_ns - EPOCH_NS, *m.position, *m.attitude, *m.velocity, *m.rates] for m in messages
    ])  # fmt: skip


def recorded(path: Path) -> Any:
    with Recording(path) as recording:
        table = recording.columns(TOPIC)
    return numbers(messages_of(TOPICS[TOPIC].typename, table))


def compiled(folder: Path) -> None:
    with McapSink(folder / "compiled.mcap") as sink:
        write_flight(sink, fly_scenario(SCENARIO, SEED))
    np.save(folder / "compiled.npy", recorded(folder / "compiled.mcap"))


def batch(folder: Path) -> None:
    """Fly two vehicles to the first decision, and the second of them alone."""
    from tombo_collision.reactions.policy import Policy

    episodes = Episodes(replace(SCENARIO, reaction=Policy()), 2)
    episodes.reset([0, 1], [np.random.default_rng(0)] * 2, [SEED + 1, SEED])
    tick = int(episodes.batch.flights.progress["tick"][1])
    memory = episodes.batch.flights.memories[-1][0][1].copy()
    alone: list[Any] = []
    flown = replace(SCENARIO, reaction=Policy(), duration=tick * TICK_S)
    fly_scenario(flown, SEED, finish=lambda cores: alone.append(cores[-1].memory.copy()))
    for name in memory.dtype.names:  # field by field: what lies between them is not written
        assert alone[0][name].tobytes() == memory[name].tobytes(), name
    np.save(folder / "batch.npy", numbers([memory.message]))


def replay(folder: Path) -> None:
    with Recording(folder / "compiled.mcap") as recording:
        inputs = Inputs(recording, SCENARIO, ("wind",), PoseTrack.none())
        _, published, _ = replayed(inputs, "wind")
    np.save(folder / "replay.npy", numbers([message for _, _, message in published]))


def nodes(folder: Path) -> None:
    """Read what the nodes have recorded."""
    np.save(folder / "nodes.npy", recorded(folder / "nodes.mcap"))


def parameters(folder: Path) -> None:
    table = suite_parameters(SCENARIO, SEED, lockstep=True)
    table["recorder"]["single_file"] = str(folder / "nodes.mcap")
    (folder / "parameters.yaml").write_text(parameter_yaml(table))


WAYS: dict[str, Callable[[Path], None]] = {
    way.__name__: way for way in (compiled, batch, replay, nodes, parameters)
}

if __name__ == "__main__":
    for name in sys.argv[2:]:
        WAYS[name](Path(sys.argv[1]))

"""Lockstep over DDS: the flight of the nodes is the headless one, and nothing waits for ever."""

from __future__ import annotations

import signal
import time
from collections import defaultdict
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from ros_bench import NodeProcess
from tombo_bag.flight_topics import write_flight
from tombo_bag.formats.mcap_sink import McapSink
from tombo_bag.message_codec import MessageCodec, messages_of
from tombo_bag.recording import Recording
from tombo_bag.topics import TOPICS, TRUE_ODOMETRY, TRUE_ROTORS
from tombo_flight.flight import fly_scenario
from tombo_flight.run_wiring import run_wiring, warm_up_nodes
from tombo_flight.scenario import Scenario, load_scenario
from tombo_flight.suite.nodes import SUITE
from tombo_flight.suite.parameter_yaml import parameter_yaml, suite_parameters

SETTINGS = (
    "mission.takeoff_time=0.2",
    "mission.climb_speed=1.2",
    "mission.approach_time=3.5",
    "obstacle.x=1.4",
    "duration=9.5",
)
"""The paper's flight, with little hover before the collision."""


def start_suite(
    start, folder: Path, scenario: Scenario, seed: int, **sim
) -> dict[str, NodeProcess]:
    """Start all nodes in lockstep; the recorder writes flight.mcap."""
    parameters = suite_parameters(scenario, seed, lockstep=True)
    parameters["recorder"]["output"] = str(folder / "flight.mcap")
    parameters["sim"] |= sim
    file = folder / "parameters.yaml"
    file.write_text(parameter_yaml(parameters))
    return {name: start(module, "--params-file", str(file)) for name, module in SUITE.items()}


def test_flight_with_a_collision_equals_the_wiring_to_the_last_bit(start, tmp_path):
    settings = (*SETTINGS, "reaction.name=reflex")  # more topics than with the bounce
    scenario, seed = load_scenario("paper_collision", settings), 3
    warm_up_nodes(scenario)
    nodes = start_suite(start, tmp_path, scenario, seed)
    published = defaultdict(list)
    run_wiring(scenario, seed, lambda topic, message: published[topic].append(message))
    assert len(published["/collision_event"]) == len(published["/contact_event"]) == 1
    assert nodes["sim"].process.wait(150.0) == 0, nodes["sim"].output
    assert nodes["recorder"].end() == 0
    assert "lost 0" in nodes["recorder"].output
    with Recording(tmp_path / "flight.mcap") as recording:
        for topic, messages in published.items():
            typename = TOPICS[topic].typename
            codec = MessageCodec(typename)
            recorded = messages_of(typename, recording.columns(topic))
            assert [codec.encode(m) for m in recorded] == [codec.encode(m) for m in messages], (
                topic
            )
    with McapSink(tmp_path / "headless.mcap") as sink:
        write_flight(sink, fly_scenario(scenario, seed))
    paths = (tmp_path / name for name in ("flight.mcap", "headless.mcap"))
    with Recording(next(paths)) as one, Recording(next(paths)) as other:
        for spec in (TRUE_ODOMETRY, TRUE_ROTORS):
            assert list(one.messages(spec.name).messages) == list(
                other.messages(spec.name).messages
            ), spec.name


def test_node_that_dies_ends_the_flight_with_its_name(start, tmp_path):
    scenario = load_scenario("hover")
    nodes = start_suite(start, tmp_path, scenario, 0, lockstep_patience=2.0)
    file = tmp_path / "flight.mcap"
    end = time.monotonic() + 120.0
    while not (file.exists() and file.stat().st_size > 50_000):
        assert time.monotonic() < end, nodes["sim"].output
        time.sleep(0.1)
    nodes["detector"].process.send_signal(signal.SIGKILL)
    assert nodes["sim"].process.wait(30.0) == 2
    assert "no answer to the tick at" in nodes["sim"].output
    assert "from detector within 2 s: has it ended?" in nodes["sim"].output
    assert nodes["recorder"].end() == 0

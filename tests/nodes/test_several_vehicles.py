"""`tombo up --vehicles 2`: two vehicles take off in their namespaces, into one recording."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from tombo_bag.message_codec import messages_of
from tombo_bag.recording import Recording
from tombo_bag.topics import TOPICS
from tombo_flight.flight import fly_several
from tombo_flight.run_wiring import warm_up_nodes
from tombo_flight.scenario import load_scenario
from tombo_flight.several_vehicles import vehicles_of
from tombo_flight.suite.nodes import GROUP, RECORDER, groups
from tombo_flight.suite.parameter_yaml import parameter_yaml, several_parameters


@pytest.mark.real_time
def test_two_vehicles_hover_in_namespaces_and_one_recording_has_both(domain, tmp_path):
    words = ("up", "hover", "--vehicles", "2", "--json", "-o", str(tmp_path / "out"))
    command = [sys.executable, "-m", "tombo_bringup.cli.main", *words]
    settings = ("mission.height=0.6", "mission.takeoff_time=0.2", "mission.land_time=600")
    process = subprocess.Popen(
        [*command, *(word for each in settings for word in ("--set", each))],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        end_s, phases = time.monotonic() + 200.0, {}
        while phases != {"v1": "hover", "v2": "hover"}:
            assert time.monotonic() < end_s, phases
            event = json.loads(process.stdout.readline())
            if "vehicles" in event:
                phases = {name: of["phase"] for name, of in event["vehicles"].items()}
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    (bag,) = (tmp_path / "out" / "bag").glob("*.mcap")
    needed = ("/mocap/pose", "/imu/data_raw", "/odometry", "/rotor_command", "/mission/status")
    with Recording(bag) as recording:
        for vehicle in ("v1", "v2"):
            for name in needed:
                assert recording.topics[f"/{vehicle}{name}"].count > 0
        assert not set(recording.topics) & set(needed)


def test_four_vehicles_in_lockstep_equal_the_headless_ones_to_the_last_bit(start, tmp_path):
    settings = ("mission.takeoff_time=0.2", "mission.height=0.5", "duration=2.0")
    scenario = load_scenario("hover", settings)
    warm_up_nodes(scenario)
    parameters = several_parameters(scenario, 3, 4, lockstep=True)
    parameters["recorder"]["output"] = str(tmp_path / "flight.mcap")
    file = tmp_path / "parameters.yaml"
    file.write_text(parameter_yaml(parameters))
    nodes = {name: f"{GROUP} {' '.join(of)}" for name, of in groups(4).items()}
    nodes["recorder"] = RECORDER
    processes = {name: start(words, "--params-file", str(file)) for name, words in nodes.items()}
    flights = fly_several(vehicles_of(scenario, 4, 3))
    assert processes["sim"].process.wait(240.0) == 0, processes["sim"].output
    assert processes["recorder"].end() == 0
    with Recording(tmp_path / "flight.mcap") as recording:
        for name, flight in flights.items():
            for topic in ("/mocap/pose", "/mission/setpoint", "/setpoint", "/odometry"):
                table = recording.columns(f"/{name}{topic}")
                messages = messages_of(TOPICS[topic].typename, table)
                flown = flight[topic]["position"].values
                assert len(flown) > 50
                np.testing.assert_array_equal([m.position for m in messages], flown, topic)

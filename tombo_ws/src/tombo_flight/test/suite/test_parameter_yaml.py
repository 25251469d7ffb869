"""The parameter file of the suite: every value of a scenario arrives, with its type."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tombo_control.planning.mission import MissionParams
from tombo_dynamics.params import from_mapping
from tombo_flight.scenario import Scenario, as_mapping, load_scenario
from tombo_flight.suite.nodes import SUITE
from tombo_flight.suite.parameter_yaml import parameter_yaml, suite_parameters

CONFIG = Path(__file__).parents[5] / "tombo_ws/src/tombo_bringup/config/suite.yaml"
NO_PARAMETER = {"name", "description", "duration", "model"}
"""Values that are not parameters of a node: names, and when `tombo fly` ends."""


def flat(values: dict[str, Any], above: str = "") -> dict[str, Any]:
    found = {}
    for key, value in values.items():
        if isinstance(value, dict):
            found |= flat(value, f"{above}{key}.")
        else:
            found[above + key] = value
    return found


def read(text: str) -> dict[str, dict[str, Any]]:
    return {
        name.removeprefix("/**/"): flat(values["ros__parameters"])
        for name, values in yaml.safe_load(text).items()
    }


@pytest.mark.parametrize("name", ["paper_collision", "known_obstacle", "aggressive", "survey"])
def test_every_value_of_a_scenario_arrives_at_a_node(name):
    scenario = load_scenario(
        name, ["reaction.name=none", "vehicle.rotor_inertia=6.1e-05", "propeller.conf=10"]
    )
    nodes = read(parameter_yaml(suite_parameters(scenario, 7)))
    anywhere = {key: value for values in nodes.values() for key, value in values.items()}

    values = as_mapping(scenario)
    reaction = values.pop("reaction")
    values[reaction.pop("name")] = reaction  # a section of its own for each reaction
    wanted = flat({k: v for k, v in values.items() if k not in NO_PARAMETER})

    course = anywhere["mission.course"]
    anywhere["mission.course"] = yaml.safe_load(course) if course else None
    missing = {k: v for k, v in wanted.items() if k not in anywhere or anywhere[k] != v}
    assert not missing
    assert nodes["sim"]["seed"] == 7
    assert nodes["reaction"]["reaction"] == "none"
    assert nodes["controller"]["vehicle.rotor_inertia"] == 6.1e-05


def test_ros_reads_the_default_file_as_it_is_meant(monkeypatch, tmp_path):
    """ROS's own reader, and a node in a namespace."""
    rclpy = pytest.importorskip("rclpy")
    from rclpy.node import Node

    monkeypatch.setenv("ROS_DOMAIN_ID", "78")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "--params-file", str(CONFIG)], context=context)
    try:
        for name in SUITE:
            node = Node(
                name,
                namespace="/drone",
                context=context,
                automatically_declare_parameters_from_overrides=True,
            )
            given = {key: p.value for key, p in node._parameter_overrides.items()}
            node.destroy_node()
            wanted = read(CONFIG.read_text()).get(name, {})
            assert given == wanted
            assert {k: type(v) for k, v in given.items()} == {
                k: type(v) for k, v in wanted.items()
            }
    finally:
        rclpy.shutdown(context=context)


def test_a_node_given_the_text_of_a_course_has_that_course():
    scenario = load_scenario("survey")
    text = suite_parameters(scenario, 0)["mission"]["mission"]["course"]
    assert isinstance(text, str)
    given = from_mapping(MissionParams, {"course": yaml.safe_load(text)}, "mission")
    assert given.course == scenario.mission.course
    assert suite_parameters(Scenario(), 0)["mission"]["mission"]["course"] == ""

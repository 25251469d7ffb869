"""compose.yaml: of the Compose specification, whole, and true to the suite."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tombo_flight.suite.nodes import SUITE

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docker" / "compose.yaml"
COMPOSE: dict[str, Any] = yaml.safe_load(FILE.read_text())
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
OURS = {name: s for name, s in SERVICES.items() if s["image"].startswith("tombo")}
LAUNCH = ROOT / "tombo_ws/src/tombo_bringup/launch"


# Key -> type, from the Compose specification; only those that are of use here.
def version() -> str:
    text = (ROOT / "tombo_ws/src/tombo_bringup/package.xml").read_text()
    found = re.search(r"<version>(.*)</version>", text)
    assert found is not None
    return found[1]


def launched(service: dict[str, Any]) -> list[str]:
    """Return the nodes that a service's launch file starts."""
    source = (LAUNCH / service["command"][3]).read_text()
    return [name for name in SUITE if f'"{name}"' in source]


def test_the_parts_of_the_suite_are_services():
    always = {name for name, service in SERVICES.items() if "profiles" not in service}
    assert always == {"sim", "control", "collision", "recorder"}
    assert {p for s in SERVICES.values() for p in s.get("profiles", [])} == {"foxglove", "px4"}


def test_together_they_start_every_node_once():
    always = [s for s in OURS.values() if "profiles" not in s]
    nodes = [n for s in always if s["command"][1] == "launch" for n in launched(s)]
    assert sorted(nodes) == sorted(SUITE)


@pytest.mark.parametrize("name", ["sim", "control", "collision", "recorder"])
def test_the_healthcheck_looks_for_the_nodes_of_the_service(name: str):
    wanted = SERVICES[name]["environment"]["TOMBO_NODES"].split()
    assert wanted == [node for node in wanted if node in SUITE]
    assert sorted(wanted) == sorted(launched(SERVICES[name]))


def test_the_healthcheck_of_the_flight_over_mavlink_looks_for_executables():
    source = (LAUNCH / "px4.launch.py").read_text() + (LAUNCH / "collision.launch.py").read_text()
    for name in SERVICES["px4_suite"]["environment"]["TOMBO_NODES"].split():
        assert f'"{name}_node"' in source or f'"{name}"' in source


@pytest.mark.parametrize("name", OURS)
def test_a_command_is_one_that_exists(name: str):
    ros2, verb, package, what, *arguments = OURS[name]["command"]
    assert ros2 == "ros2"
    if verb == "run":
        assert (package, what) == ("foxglove_bridge", "foxglove_bridge")
        return
    assert (verb, package) == ("launch", "tombo_bringup")
    source = (LAUNCH / what).read_text()
    for argument in arguments:
        assert f'"{argument.partition(":=")[0]}"' in source


@pytest.mark.parametrize("name", SERVICES)
def test_images_are_of_a_given_version(name: str):
    tag = SERVICES[name]["image"].partition(":")[2]
    assert tag and tag != "latest"
    if name in OURS:
        assert tag == version()


@pytest.mark.parametrize("name", OURS)
def test_a_container_hears_the_others_keeps_time_and_is_stopped_gently(name: str):
    """Same network and same /dev/shm, or Fast DDS finds participants and delivers nothing."""
    service = OURS[name]
    assert (service["network_mode"], service["ipc"]) == ("host", "host")
    environment = service["environment"]
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert environment["ROS_DOMAIN_ID"] == "${ROS_DOMAIN_ID:-0}"
    pacing = (ROOT / "tombo_ws/src/tombo_ros/tombo_ros/pacing.py").read_text()
    wanted = [int(n) for pair in re.findall(r"= Priority\((\d+), (\d+)\)", pacing) for n in pair]
    assert service["ulimits"]["rtprio"] >= max(wanted) and service["cap_add"] == ["SYS_NICE"]
    assert service["stop_signal"] == "SIGINT"  # as Ctrl-C
    assert re.fullmatch(r"[1-9]\d*s", service["stop_grace_period"])


def test_nothing_is_said_twice():
    """YAML takes the second of two equal keys, silently."""

    class Strict(yaml.SafeLoader):
        pass

    def mapping(loader: yaml.SafeLoader, node: yaml.MappingNode) -> Any:
        keys = [key.value for key, _ in node.value if key.value != "<<"]
        assert len(keys) == len(set(keys)), f"line {node.start_mark.line + 1}: {keys}"
        return yaml.SafeLoader.construct_mapping(loader, node, deep=True)

    Strict.add_constructor("tag:yaml.org,2002:map", mapping)
    yaml.load(FILE.read_text(), Strict)

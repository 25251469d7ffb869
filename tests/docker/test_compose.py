"""compose.yaml: of the Compose specification, whole, and true to the suite."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from tombo_dynamics.yaml_text import read_yaml
from tombo_flight.suite.nodes import SUITE

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docker" / "compose.yaml"
COMPOSE: dict[str, Any] = read_yaml(FILE, "compose.yaml")
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
OURS = {name: s for name, s in SERVICES.items() if s["image"].startswith("tombo")}
LAUNCH = ROOT / "tombo_ws/src/tombo_bringup/launch"


def version() -> str:
    text = (ROOT / "tombo_ws/src/tombo_bringup/package.xml").read_text()
    found = re.search(r"<version>(.*)</version>", text)
    assert found is not None
    return found[1]


def launched(service: dict[str, Any]) -> list[str]:
    """Return the nodes that a service's launch file starts."""
    source = (LAUNCH / service["command"][3]).read_text()
    return [name for name in SUITE if f'"{name}"' in source]


def test_together_they_start_every_node_once_and_look_whether_it_runs():
    always = [s for s in OURS.values() if "profiles" not in s]
    assert sorted(node for s in always for node in launched(s)) == sorted(SUITE)
    for service in always:
        assert sorted(service["environment"]["TOMBO_NODES"].split()) == sorted(launched(service))


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


@pytest.mark.parametrize("name", OURS)
def test_built_from_the_dockerfile_beside_it_as_this_version(name: str):
    build = OURS[name]["build"]
    context = (FILE.parent / build["context"]).resolve()
    assert context == ROOT
    text = (context / build["dockerfile"]).read_text()
    assert re.search(rf"^FROM .* AS {build['target']}$", text, re.M)
    assert all(re.search(rf"^ARG {argument}=", text, re.M) for argument in build["args"])
    assert OURS[name]["image"].partition(":")[2] == version()


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

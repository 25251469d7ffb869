"""What each launch file starts, with which parameters; run over stand-ins for `launch`."""

from __future__ import annotations

import re
import sys
from configparser import ConfigParser
from pathlib import Path

import launch_bench as bench
import pytest

from tombo_flight.suite.nodes import PX4_SUITE, SUITE

FILES = sorted(path.name for path in bench.LAUNCH.glob("*.launch.py"))
PARTS = ("sim.launch.py", "control.launch.py", "collision.launch.py", "recorder.launch.py")
LAUNCHED = (*PARTS, "suite.launch.py", "px4.launch.py")
NODES = set(SUITE)
MODULES = {*SUITE.values(), *PX4_SUITE.values()}


@pytest.fixture(autouse=True)
def _stand_ins(monkeypatch: pytest.MonkeyPatch):
    bench.install(monkeypatch)
    yield
    sys.modules.pop("tombo_bringup.launching", None)


def entry_points(package: str) -> dict[str, str]:
    """Executable -> `module:function`, as the package's setup.cfg installs them."""
    found = ConfigParser()
    found.read(bench.SRC / package / "setup.cfg")
    lines = found["options.entry_points"]["console_scripts"].split("\n")
    return dict(line.replace(" ", "").split("=") for line in lines if line)


def node_of(started: list, name: str) -> bench.Started:
    (found,) = (node for node in started if node.name == name)
    return found


def names(started: list) -> list[str]:
    return sorted(node.name.split("/")[-1] for node in started)


@pytest.mark.parametrize("file", LAUNCHED)
def test_every_node_is_an_executable_of_its_package(file: str):
    for node in bench.launch(file):
        point = entry_points(node.package)[node.executable]
        module, function = point.split(":")
        source = bench.SRC / node.package / (module.replace(".", "/") + ".py")
        assert re.search(rf"^(def )?{function}( = |\()", source.read_text(), re.M), point
        assert module in MODULES
        assert module in (SUITE.get(node.name.strip("/")), PX4_SUITE.get(node.name.strip("/")))


def test_the_suite_is_every_node_once():
    assert names(bench.launch("suite.launch.py", record="runs/bag")) == sorted(NODES)


@pytest.mark.parametrize(
    ("file", "arguments", "starts"),
    [
        ("suite.launch.py", {}, True),
        ("suite.launch.py", {"sim": "false"}, False),
        ("px4.launch.py", {}, True),
        ("px4.launch.py", {"sim": "false"}, False),
        ("control.launch.py", {}, False),
    ],
)
def test_only_a_simulated_vehicle_takes_off_by_itself(file: str, arguments: dict, starts: bool):
    mission = node_of(bench.launch(file, **arguments), "/mission")
    assert mission.parameters["auto_start"] is starts


def test_over_mavlink_px4_stands_for_estimator_and_controller():
    started = bench.launch("px4.launch.py", record="runs/bag")
    assert names(started) == sorted(PX4_SUITE)
    assert {node.executable for node in started} == {
        module.partition(".")[2] for module in PX4_SUITE.values()
    }
    without = bench.launch("px4.launch.py", sim="false", url="serial:///dev/ttyACM0:57600")
    assert names(without) == sorted(PX4_SUITE.keys() - {"sim", "recorder"})
    (bridge,) = (node for node in without if node.executable == "px4_bridge_node")
    assert bridge.parameters["link.url"] == "serial:///dev/ttyACM0:57600"
    assert "px4.axes_evidence" not in bridge.parameters, "a real vehicle's axes are to be proven"
    model = node_of(started, "/px4_bridge")
    assert model.parameters["px4.axes_evidence"] == "simulated"


def test_a_real_px4_gets_its_vehicle_from_the_simulator_link():
    started = bench.launch("px4.launch.py", sim="false", hil="true")
    sim = node_of(started, "/sim")
    assert (sim.package, sim.executable) == ("tombo_px4", "hil_sim_node")


@pytest.mark.parametrize("file", ["collision.launch.py", "suite.launch.py", "px4.launch.py"])
def test_a_reaction_by_name_wins_over_the_file_of_parameters(file: str):
    assert "reaction" not in node_of(bench.launch(file), "/reaction").parameters
    named = node_of(bench.launch(file, reaction="none"), "/reaction")
    assert named.parameters["reaction"] == "none"


@pytest.mark.parametrize("tool", ["rviz", "foxglove"])
def test_a_tool_comes_when_asked_for(tool: str):
    plain = bench.launch("suite.launch.py", use_sim_time="true")
    more = bench.launch("suite.launch.py", use_sim_time="true", **{tool: "true"})
    (added,) = (node for node in more if node not in plain)
    assert added.package == {"rviz": "rviz2", "foxglove": "foxglove_bridge"}[tool]
    assert added.parameters["use_sim_time"] == "true"
    for word in added.command:
        assert not word.startswith("/") or Path(word).is_file()


def test_the_parts_make_up_the_suite():
    starts = {"control.launch.py": {"auto_start": "true"}}
    parts = [node for file in PARTS for node in bench.launch(file, **starts.get(file, {}))]
    assert parts == bench.launch("suite.launch.py", record="runs/bag")


@pytest.mark.parametrize("file", LAUNCHED)
def test_common_arguments_reach_every_node(file: str, tmp_path: Path):
    mine = tmp_path / "mine.yaml"
    started = bench.launch(
        file, namespace="uav1", use_sim_time="true", log_level="debug", params_file=str(mine)
    )
    for node in started:
        assert node.name.startswith("uav1/")
        assert node.parameters["use_sim_time"] is True
        assert node.command == ["--log-level", "debug"]
        assert node.files == [mine]


@pytest.mark.parametrize(
    ("page", "file", "of_another_page"),
    [("nodes.md", "suite.launch.py", ()), ("px4.md", "px4.launch.py", ("sim.launch.py",))],
)
def test_the_page_names_every_argument(page: str, file: str, of_another_page: tuple[str, ...]):
    text = (bench.SRC.parents[1] / "docs" / page).read_text()
    for name in bench.arguments_of(file).keys() - set().union(
        *map(bench.arguments_of, of_another_page)
    ):
        assert f"`{name}`" in text or f"{name}:=" in text, name


@pytest.mark.parametrize(
    ("file", "words"), [("fly", "fly hover --seed 3"), ("multi", "up hover --vehicles 2 --seed 3")]
)
def test_a_command_is_run_with_its_arguments(file: str, words: str):
    (process,) = bench.launch(f"{file}.launch.py", scenario="hover", seed="3")
    assert " ".join(process.command).startswith(f"lib/tombo_bringup/tombo {words} -o runs/")

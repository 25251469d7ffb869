"""Lists, help and version: right, quick, and JSON alone when asked for."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
import typer

from tombo_bringup.cli.main import application
from tombo_collision.reactions import REGISTRY as REACTIONS
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_flight.scenario import load_scenario


def test_scenarios_are_listed_and_each_can_be_loaded(tombo):
    listed = tombo("list", "scenarios", "--json").json

    values = [entry["name"] for entry in listed]
    assert {"paper_collision", "hover", "no_obstacle", "aggressive"} <= set(values)
    for entry in listed:
        assert load_scenario(entry["name"]).description == entry["description"] != ""
    text = tombo("list", "scenarios").out
    assert all(name in text for name in values)


def test_effects_are_those_of_the_registry(tombo):
    listed = tombo("list", "effects", "--json").json

    assert [entry["name"] for entry in listed] == list(REGISTRY)
    for entry in listed:
        assert entry["doc"]
        for p in entry["parameters"]:
            assert p["bounds"][0] <= p["null"] <= p["bounds"][1]
            assert p["unit"] and p["doc"]
    text = tombo("list", "effects").out
    assert "steady_wind" in text
    assert "-15 to 15" in text


def test_a_reaction_in_the_list_can_be_flown_as_the_list_says(tombo):
    entries = tombo("list", "reactions", "--json").json
    assert {entry["name"] for entry in entries} == set(REACTIONS)
    for entry in entries:
        assert set(entry["needs"]) <= {"mocap", "imu", "rotor_speeds"}
        given = {p["name"]: json.dumps(p["default"]) for p in entry["parameters"]}
        settings = [f"reaction.{key}={value}" for key, value in given.items()]
        chosen = [f"reaction.name={entry['name']}", *settings]
        if "network" in given:
            with pytest.raises(InputError, match=r"reaction\.network"):
                load_scenario("hover", chosen)
        else:
            assert load_scenario("hover", chosen).reaction == REACTIONS[entry["name"]]()
        for p in entry["parameters"]:
            assert p["doc"]
            if p["name"] == "network":  # a file: no number, and none by default
                assert p["default"] is None and p["bounds"] is None
                continue
            assert p["bounds"][0] <= p["default"] <= p["bounds"][1] and p["unit"]
    assert "0.05 to 20" in tombo("list", "reactions").out


@pytest.mark.parametrize(
    "arguments", [(), ("-h",), ("--help",), ("fly", "-h"), ("propeller", "-h"), ("list", "-h")]
)
def test_help(tombo, arguments):
    result = tombo(*arguments)
    assert result.code == 0
    assert "Usage: tombo" in result.out
    assert result.err == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments", [["--help"], ["list", "scenarios"], ["--version"], ["fly", "-h"], ["sweep", "-h"]]
)
def test_what_only_lists_loads_no_model(arguments):
    code = (
        "import sys\n"
        "from tombo_bringup.cli.main import run\n"
        f"try: run({arguments!r})\n"
        "except SystemExit: pass\n"
        "slow = {'numpy', 'numba', 'scipy', 'matplotlib', 'rosbags', 'filterpy', 'pandas',"
        " 'pyarrow'}\n"
        "sys.exit(f'loaded: {slow & set(sys.modules)}' if slow & set(sys.modules) else 0)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_the_help_lists_few_commands_and_names_all_others(tombo):
    text = " ".join(re.sub("[^ -~]", " ", tombo("--help").out).split())
    group = typer.main.get_command(application())
    listed = [name for name, command in group.commands.items() if not command.hidden]
    assert len(listed) <= 19
    assert all(name in text for name in group.commands)

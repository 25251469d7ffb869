"""`tombo fly --px4` on the command line: what the words mean, what is refused, who is asked."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tombo_bag.mcap_sink import McapSink
from tombo_bringup import node_flight
from tombo_bringup.cli.optional_url import with_url
from tombo_bringup.suite import nodes

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "suite"))

from px4_bench import speaking
from suite_bench import FAKES


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("--px4", "--px4=sim"),
        ("--px4 hover", "--px4=sim hover"),
        ("hover --px4 --json", "hover --px4=sim --json"),
        ("--px4 udpin://127.0.0.1:14540 hover", "--px4=udpin://127.0.0.1:14540 hover"),
        ("--px4=serial:///dev/ttyACM0:57600", "--px4=serial:///dev/ttyACM0:57600"),
        ("--px4 x://y --px4", "--px4=x://y --px4=sim"),
        ("--px4 runs/a://b", "--px4=sim runs/a://b"),
        ("--seed 3 -- --px4 a://b", "--seed 3 -- --px4 a://b"),
        ("hover", "hover"),
        ("", ""),
    ],
)
def test_the_url_may_be_left_out(words: str, wanted: str):
    assert with_url(words.split()) == wanted.split()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--px4", "--nodes"), "--px4: accepted: without --nodes, --seeds and --no-record"),
        (("--px4", "--seeds", "0:3"), "--px4: accepted: without --nodes"),
        (("--px4", "--no-record"), "--px4: accepted: without --nodes"),
        (("--px4", "--speed", "2"), "--speed and --domain: accepted: with --nodes only"),
        (("--yes",), "--yes and --bridge: accepted: with --px4 only"),
        (("--bridge", "px4.setpoint=rates"), "--yes and --bridge: accepted: with --px4 only"),
        (("--px4", "nowhere://", "--yes"), "'nowhere://' is no URL of a link"),
        (("--px4", "udpin://192.168.1.20:14540", "--yes"), "not to this machine"),
        (("--px4", "udpin://127.0.0.1:14540"), "accepted: with --yes, or on a terminal"),
        (("--px4", "--bridge", "px4.setpont=rates"), "did you mean 'setpoint'"),
        (("--px4", "--bridge", "px4.setpoint=throttle"), "unknown value of px4.setpoint"),
        (("--px4", "--bridge", "px4.stream_rate=0"), "px4.stream_rate: 0 is out of bounds"),
        (("--px4", "--bridge", "pix4.setpoint=rates"), "unknown section of --bridge"),
        (("--px4", "--bridge", "link.url=a"), "accepted: the URL behind --px4"),
        (("--px4", "--bridge", "link.allow_remote=1"), "accepted: true or false"),
        (("--px4", "--bridge", "link=3"), "accepted: a parameter of link"),
        (("--px4", "--bridge", "link.key_file=/no/such"), "can't be read (no such file"),
        (("--px4", "--bridge", "setpoint"), "--bridge 'setpoint': expected key=value"),
    ],
)
def test_what_does_not_go_together_is_refused(tombo, tmp_path, arguments, complaint):
    result = tombo("fly", "hover", *arguments)

    assert result.code == 2
    assert complaint in result.err
    assert len(result.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_an_armed_vehicle_is_left_alone(tombo, tmp_path):
    with speaking(1, armed=True) as url:
        result = tombo("fly", "hover", "--px4", url, "--yes")

    assert result.code == 2
    assert "armed, in mode hold: somebody else flies it" in result.err
    assert list(tmp_path.iterdir()) == []


def test_who_is_asked_and_says_no_arms_nothing(tombo, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("typer.confirm", lambda text, **more: False)
    with speaking(1) as url:
        result = tombo("fly", "hover", "--px4", url)

    assert result.code == 1
    assert f"At {url} is a PX4 quadrotor, system 1, disarmed, in mode hold." in result.err
    assert "takes off to 2 m and flies hover" in result.err
    assert "not confirmed: nothing was armed" in result.err
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def fly(tombo, tmp_path, monkeypatch):
    """`tombo fly hover --px4 ...` with fake nodes, and a bridge that says what it is given."""

    def command(*arguments: str, says: dict[str, object], **modules: str):
        McapSink(tmp_path / "empty.mcap").close()
        suite = {"px4_bridge": "fake_good", "sim": "fake_good", "recorder": "fake_recorder"}
        monkeypatch.setattr(node_flight, "PX4_SUITE", {**suite, **modules})
        monkeypatch.setattr(nodes, "MONITOR_MODULE", "fake_px4_monitor")
        monkeypatch.setenv("PYTHONPATH", str(FAKES))
        monkeypatch.setenv("FAKE_BAG", str(tmp_path / "empty.mcap"))
        monkeypatch.setenv("FAKE_METADATA", str(tmp_path / "told.json"))
        monkeypatch.setenv("FAKE_FLIGHT", "none")
        monkeypatch.setenv("FAKE_PX4", json.dumps(says))
        return tombo("fly", "hover", "--px4", "-o", "out", *arguments)

    return command


def test_a_refused_arming_is_one_line_with_px4s_words_and_leaves_the_recording(fly, tmp_path):
    why = "arming denied: 'Resolve system health failures first'"
    result = fly(says={"stage": "given up", "why": why})

    assert result.code == 1
    assert result.err == (f"Error: PX4 did not take off: {why}; recording and logs are in 'out'\n")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"flight.mcap", "nodes.log"}
    assert "== px4_bridge" in (tmp_path / "out" / "nodes.log").read_text()
    assert json.loads((tmp_path / "told.json").read_text())["tombo_flight"]["mode"] == "px4"


def test_without_its_bridge_there_is_no_flight(fly, tmp_path):
    result = fly(says={}, px4_bridge="fake_broken")

    assert result.code == 2
    assert "px4_bridge has ended, exit code 1: Error: parameter" in result.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--px4", "--speed", "2"), "--speed 2: accepted: without --px4, which is in real time"),
        (("--yes",), "--yes and --bridge: accepted: with --px4 only"),
        (("--px4", "udpin://127.0.0.1:14540"), "accepted: with --yes, or on a terminal"),
        (("--px4", "--without", "controller"), "unknown node 'controller'"),
    ],
)
def test_up_takes_and_refuses_the_same(tombo, tmp_path, arguments, complaint):
    result = tombo("up", "hover", *arguments)

    assert result.code == 2
    assert complaint in result.err
    assert list(tmp_path.iterdir()) == []

"""`tombo fly --px4` on the command line: meaning of the arguments, refused input, the vehicle at
the other end."""

from __future__ import annotations

import json
import os
import signal
import threading
import time

import pytest
from px4_bench import speaking
from suite_bench import FAKES, names

from in_time import in_time
from tombo_bag.formats.mcap_sink import McapSink
from tombo_bringup.cli.flight.fly_nodes import may_arm
from tombo_bringup.cli.flight.optional_url import expand_url_option
from tombo_flight.flight import fly_scenario
from tombo_flight.process.stop_signals import StopSignals
from tombo_flight.scenario import load_scenario
from tombo_flight.suite import node_flight, nodes
from tombo_flight.suite.px4_connection import px4_connection
from tombo_flight.suite.px4_flight import BridgeMonitor


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("--px4", "--px4=lab"),
        ("--px4 hover", "--px4=lab hover"),
        ("hover --px4 --json", "hover --px4=lab --json"),
        ("--px4 udpin://127.0.0.1:14540 hover", "--px4=udpin://127.0.0.1:14540 hover"),
        ("--px4=serial:///dev/ttyACM0:57600", "--px4=serial:///dev/ttyACM0:57600"),
        ("--px4 udp.yaml", "--px4=lab udp.yaml"),
        ("--seed 3 -- --px4 a://b", "--seed 3 -- --px4 a://b"),
    ],
)
def test_the_url_may_be_left_out(words: str, wanted: str):
    assert expand_url_option(words.split()) == wanted.split()


def test_an_armed_vehicle_is_left_alone(tombo, tmp_path):
    with speaking(1, armed=True) as url:
        result = tombo("fly", "hover", "--px4", url, "--yes")

    assert result.code == 2
    assert "armed, in mode hold: somebody else flies it" in result.err
    assert list(tmp_path.iterdir()) == []


def test_a_px4_at_a_url_hovers_at_0_8_m_unless_another_flight_is_named(
    tombo, tmp_path, monkeypatch
):
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("typer.confirm", lambda text, **more: False)
    for words, plan in (
        ((), "0.8 m and flies hover"),
        (("paper_collision",), "2 m and flies pap"),
    ):
        with speaking(1) as url:
            result = tombo("fly", *words, "--px4", url)
        assert result.code == 1 and f"takes off to {plan}" in result.err
        assert f"At {url} is a PX4 quadrotor, system 1, disarmed, in mode hold." in result.err
        assert "not confirmed: nothing was armed" in result.err
    assert list(tmp_path.iterdir()) == []


def test_without_the_mission_nothing_is_said_to_fly_and_nobody_is_asked(capsys):
    scenario = load_scenario("hover")
    with speaking(1) as url, StopSignals() as stop:
        connection = px4_connection(url, [])
        assert may_arm(connection, scenario, stop, yes=False, flies=False)
    said = capsys.readouterr().err
    assert "Without the mission nothing arms it." in said and "takes off" not in said


@pytest.fixture
def fly(tombo, tmp_path, monkeypatch):
    """`tombo fly hover --px4 ...` with fake nodes, and a bridge that says what it is given."""

    def command(
        *arguments: str,
        says: dict[str, object],
        then: object = None,
        url: str = "",
        **modules: str,
    ):
        McapSink(tmp_path / "empty.mcap").close()
        suite = {"px4_bridge": "fake_good", "sim": "fake_good", "recorder": "fake_recorder"}
        monkeypatch.setattr(node_flight, "PX4_SUITE", {**suite, **modules})
        monkeypatch.setattr(nodes, "MONITOR_MODULE", "fake_px4_monitor")
        monkeypatch.setenv("PYTHONPATH", str(FAKES))
        monkeypatch.setenv("FAKE_BAG", str(tmp_path / "empty.mcap"))
        monkeypatch.setenv("FAKE_METADATA", str(tmp_path / "told.json"))
        monkeypatch.setenv("FAKE_FLIGHT", "none")
        monkeypatch.setenv("FAKE_PX4", json.dumps(says))
        monkeypatch.setenv("FAKE_PX4_THEN", json.dumps(then or {}))
        there = (url, "--yes") if url else ()
        return tombo("fly", "hover", "--px4", *there, "-o", "out", *arguments)

    return command


@pytest.fixture
def short_flight(monkeypatch):
    """A second of hover in place of the recording."""
    record = fly_scenario(load_scenario("hover", ["duration=1.0"]), 0)
    monkeypatch.setattr(node_flight, "read_flight", lambda bag, wall_s: record)
    monkeypatch.setattr(node_flight, "node_metrics", lambda recording: {"too_slow": []})
    monkeypatch.setattr("tombo_bringup.cli.flight.node_tables.print_nodes", lambda *flown: None)


@pytest.mark.slow
def test_a_refused_arming_is_one_line_with_px4s_text_and_keeps_the_bag(fly, tmp_path):
    why = "arming denied: 'Resolve system health failures first'"
    result = fly(says={"stage": "given up", "why": why})

    assert result.code == 1
    assert result.err == (f"Error: PX4 did not take off: {why}; recording and logs are in 'out'\n")
    assert names(tmp_path / "out") == {"flight.mcap", "nodes.log"}
    assert "== px4_bridge" in (tmp_path / "out" / "nodes.log").read_text()
    assert json.loads((tmp_path / "told.json").read_text())["tombo_flight"]["mode"] == "px4"


@pytest.mark.slow
@pytest.mark.usefixtures("short_flight")
def test_a_vehicle_that_stays_armed_is_reported_as_an_error(fly, monkeypatch, tmp_path):
    monkeypatch.setattr(node_flight, "draw_pictures", lambda *arguments: None)
    result = fly("--set", "duration=2.0", says={"armed": True, "mode": "position"})

    assert result.code == 1
    assert result.err.splitlines() == [
        "armed in mode position: poses go on; Ctrl-C leaves it to PX4",
        "Error: the vehicle is still armed, in mode position",
    ]
    assert "summary.json" in names(tmp_path / "out")


@pytest.mark.slow
@pytest.mark.usefixtures("short_flight")
def test_a_flight_that_a_loss_has_ended_is_no_success(fly, monkeypatch, tmp_path):
    monkeypatch.setattr(node_flight, "draw_pictures", lambda *arguments: None)
    monkeypatch.setattr(node_flight, "px4_metrics", lambda recording, flight: {})
    lost = {"armed": True, "stage": "landing", "why": "poses stand still", "faults": "flight_lost"}
    result = fly("--set", "duration=2.0", says=lost, then={"armed": False, "phase": 6})

    assert result.code == 1
    assert result.err.splitlines() == ["Error: a loss ended the flight: poses stand still"]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["px4"]["loss"] == "poses stand still"


@pytest.mark.real_time
@pytest.mark.usefixtures("short_flight")
def test_a_second_ctrl_c_in_the_air_leaves_the_vehicle_to_px4(fly, monkeypatch, tmp_path):
    presses: list[threading.Timer] = []

    def notice(text: str) -> None:
        press = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
        press.start()
        presses.append(press)

    class Pressed(BridgeMonitor):
        def see(self, *looks, **more) -> None:
            super().see(*looks, **more)
            if (self.armed and not presses) or (more["over"] and len(presses) == 1):  # the first
                notice("")

    monkeypatch.setattr(node_flight, "BridgeMonitor", Pressed)
    with speaking(1) as url:
        began = time.monotonic()
        says = {"armed": True, "mode": "offboard"}
        result = fly(says=says, url=url, px4_bridge="fake_deaf")

    with in_time():
        assert time.monotonic() - began < 12.0
    assert result.code == 130
    assert "landing; Ctrl-C again leaves it to PX4" in result.err.splitlines()
    assert result.err.endswith("Error: the vehicle is still armed, in mode offboard\n")
    assert "summary.json" in names(tmp_path / "out")

"""A flight by nodes: its end, its files, its report of failed nodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from suite_bench import FAKES, names

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.flight_topics import write_flight
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_bringup.cli.flight.node_tables import print_verdict
from tombo_dynamics.time_base import SECOND_NS
from tombo_flight.flight import fly_scenario
from tombo_flight.recorded_flight import read_flight
from tombo_flight.scenario import load_scenario
from tombo_flight.suite import nodes, running
from tombo_flight.suite.node_diagnostics import node_metrics, too_slow

SHORT = ("hover", "--set", "duration=3")


def report(values: dict[str, dict[str, object]]) -> bytes:
    """A DiagnosticArray: name → figures."""
    status = [
        {
            "name": name,
            "values": [{"key": key, "value": str(value)} for key, value in figures.items()],
        }
        for name, figures in values.items()
    ]
    return encode("diagnostic_msgs/msg/DiagnosticArray", {"status": status})


def loop(rate_hz: float, missed: int) -> dict[str, object]:
    return {
        "rate_hz": rate_hz, "jitter_p50_us": 4.0, "jitter_p99_us": 90.0, "runs": 5,
        "missed": missed,
    }  # fmt: skip


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording as the nodes leave it, of three seconds."""
    path = tmp_path_factory.mktemp("bag") / "flight.mcap"
    latency = {"latency_gyro_to_command_p50_us": 410.0, "latency_gyro_to_command_p99_us": 870.5}
    told = [
        report({"sim": {}, "sim: loop": loop(1.0, 99)}),
        report({"sim": latency, "sim: loop": loop(999.9, 2)}),
        report(
            {
                "controller": {"refused": 0},
                "controller: loop": loop(1000.0, 7),
                "controller: rate loop": loop(999.0, 1),
                "controller: attitude loop": loop(250.0, 0),
                "controller: position loop": loop(50.0, 0),
            }
        ),
    ]
    with McapSink(path) as sink:
        write_flight(sink, fly_scenario(load_scenario("hover", ["duration=3"]), 0))
        sink.add_metadata(
            RECORDER_METADATA,
            {"messages": "12345", "lost": "6", "lost:/imu/data_raw": "6", "lost:/setpoint": "0"},
        )
        channel = sink.add_channel("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        times = SECOND_NS * np.array([1, 2, 2]) + [0, 0, 1]
        sink.write_columns(Columns(channel, times, told))
    return path


@pytest.fixture
def fly(tombo: Any, bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """`tombo fly ... --nodes` with fake nodes; keyword: modules of further nodes."""

    def command(*arguments: str, flight: str = "land", source: Path = bag, **modules: str) -> Any:
        suite = {"sim": "fake_good", "recorder": "fake_recorder", **modules}
        monkeypatch.setattr(nodes, "SUITE", suite)
        monkeypatch.setattr(running, "SUITE", suite)
        monkeypatch.setattr(nodes, "MONITOR_MODULE", "fake_flight_monitor")
        monkeypatch.setenv("PYTHONPATH", str(FAKES))
        monkeypatch.setenv("FAKE_BAG", str(source))
        monkeypatch.setenv("FAKE_METADATA", str(tmp_path / "told.json"))
        monkeypatch.setenv("FAKE_FLIGHT", flight)
        return tombo("fly", *SHORT, "--nodes", "-o", "out", *arguments)

    return command


@pytest.mark.slow
def test_a_flight_that_lands_leaves_the_files_of_a_headless_one(fly, bag, tmp_path):
    result = fly("--json", "--set", "duration=30")

    assert result.code == 0, result.err
    assert names(tmp_path / "out") == {
        *("flight.mcap", "summary.json", "scenario.yaml", "flight.png", "report.html")
    }
    summary = result.json
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    wanted = read_flight(bag).summary
    assert {key: summary[key] for key in wanted if "wall" not in key and "factor" not in key} == {
        key: value for key, value in wanted.items() if "wall" not in key and "factor" not in key
    }
    assert list(summary)[-2:] == ["wall_time_s", "real_time_factor"]
    assert summary["mode"] == "nodes"
    assert summary["died"] == {}
    assert not summary["interrupted"]
    assert summary["recorder"] == {"messages": 12345, "lost": 6, "lost_on": {"/imu/data_raw": 6}}
    assert summary["too_slow"][-1] == "6 messages lost in the recording"


def test_loops_and_latency_are_the_last_that_each_node_told(bag):
    with Recording(bag) as recording:
        found = node_metrics(recording)

    assert list(found["loops"]) == ["sim", "rate", "attitude", "position"]
    assert found["loops"]["sim"] == {
        "rate_hz": 999.9, "jitter_p50_us": 4.0, "jitter_p99_us": 90.0, "missed": 2
    }  # fmt: skip
    assert found["loops"]["rate"]["missed"] == 1
    assert found["latency_gyro_to_command_us"] == {"p50": 410.0, "p99": 870.5}


@pytest.mark.parametrize(
    ("change", "lost", "said"),
    [
        ({}, "0", "The machine kept pace"),
        ({"jitter_p99_us": 1200.0}, "0", "too slow for these figures: rate 1200 us late at 99 % "),
        ({"rate_hz": 980.0, "missed": 20}, "0", "rate missed 2.0 % of its runs."),
        ({}, "12", "too slow for these figures: 12 messages lost in the recording."),
    ],
)
def test_the_verdict_says_when_the_machine_was_too_slow(change, lost, said, capsys):
    good = {"rate_hz": 1000.0, "jitter_p99_us": 400.0, "runs": 1000 - change.get("missed", 0)}
    found = too_slow({"rate": {"missed": 0, **good, **change}}, lost)
    print_verdict({"too_slow": found})

    assert said in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_node_that_dies_is_told_and_the_flight_goes_on(fly, tmp_path):
    result = fly("--set", "duration=30", mission="fake_short")

    assert result.code == 1
    assert "mission has ended, exit code 1; see nodes.log" in result.out
    assert "mission: WARN odometry_silent: no odometry" in result.out
    assert "Gyro to command: 410 us in the median, 870 us at 99 %" in result.out
    assert "The machine was too slow for these figures" in result.out
    assert "RuntimeError: a bug" in (tmp_path / "out" / "nodes.log").read_text()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["died"] == {"mission": "exit code 1"}


@pytest.mark.slow
@pytest.mark.parametrize("needed", ["sim", "recorder"])
def test_without_simulator_or_recorder_there_is_no_flight(fly, tmp_path, needed):
    McapSink(tmp_path / "empty.mcap").close()
    result = fly(
        *("--set", "duration=300"), flight="fly on", source=tmp_path / "empty.mcap",
        **{needed: "fake_broken"},
    )  # fmt: skip

    assert result.code == 2
    assert f"{needed} has ended, exit code 1: Error: parameter detector.threshold" in result.err
    assert len(result.err.splitlines()) == 1
    assert "out" not in names(tmp_path)


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_flown(fly, tmp_path):
    result = fly("--set", "duration=300", "--json", flight="interrupt")

    assert result.code == 130
    assert result.json["interrupted"]
    assert names(tmp_path / "out") == {"flight.mcap", "summary.json", "scenario.yaml"}

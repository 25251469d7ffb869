"""`tombo fly`: the files of a flight, equal every time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from rosbags.highlevel import AnyReader
from suite_bench import names

from tombo_flight.flight_output import WALL_KEYS

pytestmark = pytest.mark.slow

FILES = {"flight.mcap", "summary.json", "scenario.yaml", "flight.png", "report.html"}
ASKED_FOR = {
    "scenario", "seed", "conf", "collided", "collision_time_s", "contact_point_m", "detected",
    "detection_latency_s", "false_alarms", "x_c_m", "n_r", "x_r_m", "max_falling_distance_m",
    "max_tilt_rad", "unstable_phase_s", "recovery_time_s", "settled_error_m", "crashed",
    "wall_time_s", "real_time_factor",
}  # fmt: skip


def without_wall_times(path: Path) -> str:
    lines = path.read_text().splitlines()
    assert sum(any(f'"{key}"' in line for key in WALL_KEYS) for line in lines) == len(WALL_KEYS)
    return "\n".join(line for line in lines if not any(f'"{key}"' in line for key in WALL_KEYS))


def test_a_flight_leaves_four_complete_files(tombo, tmp_path):
    result = tombo("fly", "--seed", "3", "--json")

    assert result.code == 0
    assert result.err == ""
    folder = tmp_path / "runs" / "paper_collision-3"
    assert names(folder) == FILES
    assert names(folder.parent) == {folder.name}
    summary = result.json
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert set(summary) >= ASKED_FOR
    assert summary["seed"] == 3
    assert summary["collided"]
    assert summary["interrupted"] is False

    with AnyReader([folder / "flight.mcap"]) as bag:
        counts = {c.topic: c.msgcount for c in bag.connections}
        assert sum(counts.values()) == summary["recorded_messages"]
        assert counts["/imu/data_raw"] == round(1000 * summary["duration_s"])
        connection = next(c for c in bag.connections if c.topic == "/collision_event")
        _, _, raw = next(bag.messages([connection]))
        event = bag.deserialize(raw, connection.msgtype)
    x_c = [getattr(event.contact_position, axis) for axis in "xyz"]
    assert x_c == pytest.approx(summary["x_c_m"], abs=1e-5)

    assert (folder / "flight.png").read_bytes().startswith(b"\x89PNG\r\n")
    report = (folder / "report.html").read_text(encoding="utf-8")
    assert report.rstrip().endswith("</html>")


def test_the_same_flight_again_gives_the_same_bytes(tombo, tmp_path):
    for folder in ("first", "second"):
        assert tombo("fly", "--seed", "5", "--set", "duration=25", "-o", folder).code == 0
    first, second = tmp_path / "first", tmp_path / "second"

    assert without_wall_times(first / "summary.json") == without_wall_times(
        second / "summary.json"
    )
    for name in ("flight.mcap", "flight.png"):
        assert (first / name).read_bytes() == (second / name).read_bytes(), name


def test_options_reach_the_flight(tombo, tmp_path):
    summary = tombo(
        "fly", "--conf", "9", "--law", "published", "--reaction", "none", "--no-record", "--json",
        "--set", "propeller.conf=10", "--set", "duration=2", "--set", "vehicle.mass=0.9",
    ).json  # fmt: skip

    assert (summary["conf"], summary["law"], summary["reaction"]) == (9, "published", "none")
    (folder,) = (tmp_path / "runs").iterdir()
    assert yaml.safe_load((folder / "scenario.yaml").read_text())["vehicle"]["mass"] == 0.9
    assert not (folder / "flight.mcap").exists()

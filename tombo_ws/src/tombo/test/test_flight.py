"""`tombo.fly` is the flight of `tombo fly`; its tables are the record's arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import tombo
from tombo_bringup.cli.main import run
from tombo_collision.reactions import REGISTRY
from tombo_flight.flight_output import WALL_KEYS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flight():
    return tombo.fly("paper_collision", seed=3, **{"mission.approach_speed": 0.9, "duration": 30})


def test_it_is_the_flight_of_the_command(flight, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    settings = ["--set", "mission.approach_speed=0.9", "--set", "duration=30"]
    with pytest.raises(SystemExit):
        run(["fly", "--seed", "3", *settings, "-o", "out"])

    flight.to_mcap("flight.mcap")

    mine, its = (tmp_path / name for name in ("flight.mcap", "out/flight.mcap"))
    assert mine.read_bytes() == its.read_bytes()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    left_out = {*WALL_KEYS, "recorded_messages"}
    assert {k: v for k, v in summary.items() if k not in left_out} == {
        k: v for k, v in flight.summary.items() if k not in left_out
    }


def test_tables_agree_with_the_summary(flight):
    summary, log = flight.summary, flight.log
    contact = summary["collision_time_s"]
    assert log.index[1] == 0.001
    assert log["contact.touching"].ne(0).idxmax() == pytest.approx(contact)
    at_contact = log.loc[log.index >= contact - 1e-9].iloc[0]
    there = [at_contact[f"position.{axis}"] for axis in "xyz"]
    assert there == pytest.approx(summary["contact_position_m"], abs=1e-6)
    struck = log.iloc[round((contact + 0.05) * 1000.0)]
    assert struck["rotor_speed.front_left"] < 0.9 * struck["rotor_speed.rear_right"]
    assert np.linalg.norm(log.filter(regex="^attitude\\.[xyzw]$"), axis=1) == pytest.approx(1.0)
    events = flight.events.set_index("kind")["time_s"]
    assert events["contact"] == pytest.approx(contact)
    status = flight.table("/reaction/status")
    assert status["collisions"].iloc[-1] == 1
    x_r = status.dropna().iloc[0][["x_r.x", "x_r.y", "x_r.z"]]
    assert list(x_r) == pytest.approx(summary["x_r_m"], abs=1e-5)
    assert list(flight.table("/mission/status")["text"])[:3] == ["idle", "takeoff", "hover"]
    with pytest.raises(tombo.InputError, match="/odometry"):
        flight.table("/odometri")


def test_a_recording_is_read_back_as_a_flight_and_files_are_not_replaced(flight, tmp_path):
    path = flight.to_mcap(tmp_path / "flight.mcap")
    before = path.read_bytes()
    for write in (flight.to_mcap, flight.report):
        with pytest.raises(tombo.InputError, match="exists"):
            write(path)
    assert path.read_bytes() == before
    again = tombo.read(path)
    assert isinstance(again, tombo.Flight)
    fallen = flight.summary["max_falling_distance_m"]
    assert again.summary["max_falling_distance_m"] == pytest.approx(fallen, abs=1e-5)
    with pytest.raises(tombo.InputError, match="recording already"):
        again.to_mcap(tmp_path / "again.mcap")
    report = flight.report(tmp_path / "report.html").read_text()
    assert report.rstrip().endswith("</html>")
    assert {p.name for p in tmp_path.iterdir()} == {"flight.mcap", "report.html"}
    assert "data:image/png" in again._repr_html_()


def test_a_reaction_of_ones_own_is_flown_with_its_parameters(monkeypatch):
    monkeypatch.setattr("tombo_collision.reactions.REGISTRY", REGISTRY)
    before = dict(REGISTRY)

    @dataclass(frozen=True)
    class Back(tombo.Reaction):
        """Straight back along x."""

        name: ClassVar[str] = "straight_back"

        distance: float = tombo.param(0.5, "m", (0.1, 5.0), "how far")

        def begin(self, event, estimate, last):
            away = np.array([-1.0, 0.0, 0.0])
            return tombo.Decision(
                event.contact_position, away, event.contact_position + self.distance * away
            )

    try:
        named = tombo.fly(reaction="straight_back", **{"reaction.distance": 1.25, "duration": 26})
        given = tombo.fly(reaction=Back(1.25), duration=26)
    finally:
        REGISTRY.clear()
        REGISTRY.update(before)
    for flight in (named, given):
        x_c, x_r = (np.array(flight.summary[key]) for key in ("x_c_m", "x_r_m"))
        assert x_c - x_r == pytest.approx([1.25, 0.0, 0.0], abs=1e-5)

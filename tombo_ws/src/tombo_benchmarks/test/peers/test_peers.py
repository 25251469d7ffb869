"""The comparison with other simulators: the course, the table, and what is said of absent ones."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from statistics import median

import numpy as np
import pytest

from tombo_benchmarks.peers import __main__ as command
from tombo_benchmarks.peers import peer_process, peers_benchmark
from tombo_benchmarks.peers.course import (
    CORNERS,
    SECONDS,
    course_scenario,
    order,
    set_points,
    starts,
)
from tombo_benchmarks.peers.our_flights import (
    OurFlight,
    OurVehicles,
    OurWholeFlights,
    Reading,
    flown_course,
)
from tombo_benchmarks.peers.peer_process import PEERS, PeerProcess, default_folder, peer_python
from tombo_benchmarks.peers.peers_benchmark import (
    CASES,
    OURS,
    Case,
    Result,
    compare_courses,
    from_goal,
    measure,
    ratios,
)
from tombo_benchmarks.peers.peers_page import peers_markdown, peers_page, spread
from tombo_dynamics.errors import InputError

OUR, PEER = Case("one", OURS, "fly", 1, 100), Case("one", "rotorpy", "fly", 1, 10)


def _result(absent=None):
    readings = {
        OUR: [Reading(100, 0.5, 0.1), Reading(100, 0.5, 0.2), Reading(100, 0.5, 0.4)],
        PEER: [Reading(10, 0.5, 0.1), Reading(10, 0.5, 0.1), Reading(10, 0.5, 0.1)],
    }
    machine = {"processor": "a processor", "cores": 2, "load_before": 0.1, "load_after": 0.2}
    ends = {OURS: [0.0, 0.0, 1.003], "rotorpy": [0.004, 0.0, 1.0]}
    before = {"rotorpy, one": {"first_flight_s": 1.5}}
    return Result(readings, before, ends, {"rotorpy": 0.0006}, {}, absent or {}, machine)


def test_the_course_is_smooth_and_ends_at_its_last_corner():
    rows = set_points()
    period = SECONDS / len(rows)
    assert period == pytest.approx(0.02)
    np.testing.assert_allclose(rows[-1], [*CORNERS[-1], *[0.0] * 6], atol=1e-9)
    for corner in CORNERS:
        assert np.linalg.norm(rows[:, :3] - corner, axis=1).min() < 1e-6
    means = 0.5 * (rows[1:, 3:6] + rows[:-1, 3:6])
    np.testing.assert_allclose(np.diff(rows[:, :3], axis=0) / period, means, atol=0.02)


def test_vehicles_of_a_batch_start_apart_and_the_first_on_the_course():
    places = starts(4096)
    np.testing.assert_allclose(places[0], CORNERS[0])
    assert len(np.unique(places, axis=0)) == 4096
    assert np.abs(places - CORNERS[0]).max() <= 0.05
    json.dumps(order(course_scenario()))


@pytest.mark.slow
def test_our_batch_flies_what_one_vehicle_flies():
    _, positions = flown_course()
    np.testing.assert_allclose(positions[-1], CORNERS[-1], atol=0.02)
    vehicles = OurVehicles(17, 3000)
    for _ in range(2):
        reading = vehicles.fly()
        assert reading.steps == 17 * 3000 and reading.processor_s > 0.0
        np.testing.assert_array_equal(vehicles.position[0], positions[2999])
        assert len(np.unique(vehicles.position, axis=0)) == 17


@pytest.mark.slow
def test_whole_flights_end_at_the_collision_and_one_lands():
    assert 2 * 3000 < OurWholeFlights(2).fly().steps < 2 * 4500
    assert OurFlight().fly().steps > 8000


def test_ratios_are_of_the_same_round():
    result = _result()
    assert ratios(result.readings, OUR) == []
    assert ratios(result.readings, PEER) == pytest.approx([10.0, 5.0, 2.5])
    page = peers_page(result)
    assert page.data["cases"][1]["ratios"] == pytest.approx([10.0, 5.0, 2.5])
    speed, agreement = (section.items[0] for section in page.sections[:2])
    assert speed.rows[1][3] == spread([10.0, 5.0, 2.5]) == "5 (2.5 to 10)"
    assert speed.rows[0][2] == "0.5 (0.25 to 1)" and speed.rows[0][3] == ""
    assert agreement.rows == [(OURS, "3.0", ""), ("rotorpy", "4.0", "0.6")]
    table = peers_markdown(page.data)
    assert "| one | 0.5 k | 0.1 k; here 5 (2.5 to 10) times | – |" in table
    assert "Medians of 3 rounds" in table
    assert median(r.per_wall_s for r in result.readings[OUR]) == 200.0


def test_an_absent_simulator_is_named_and_the_rest_is_measured(monkeypatch, tmp_path, capsys):
    def failing(folder, peer, progress):
        raise InputError(f"'{peer}': no index")

    flown = []

    def ours(case):
        return lambda: flown.append(case) or Reading(case.ticks, 1.0, 0.5)

    monkeypatch.setattr(peers_benchmark, "make_environment", failing)
    monkeypatch.setattr(peers_benchmark, "_ours", ours)
    monkeypatch.setattr(
        peers_benchmark, "flown_course", lambda: (np.zeros((3, 4)), np.ones((3, 3)))
    )
    docs = tmp_path / "page.md"
    docs.write_text("before\n<!-- peers -->\n<!-- /peers -->\nafter\n")
    words = f"--rounds 2 --json --environments {tmp_path} --page {docs}"
    command.main(words.split())

    data = json.loads(capsys.readouterr().out)
    assert set(data["absent"]) == set(PEERS)
    assert {case["simulator"] for case in data["cases"]} == {OURS}
    assert [len(case["readings"]) for case in data["cases"]] == [2] * len(data["cases"])
    mine = [case for case in CASES if case.simulator == OURS]
    assert flown[len(mine) :] == mine * 2  # in turn, after a first flight of each
    assert "| one vehicle | " in docs.read_text() and docs.read_text().endswith("after\n")
    page = peers_page(measure(tmp_path, 1))
    assert any("no index" in line for line in page.sections[-1].items[0].lines)


def test_what_pip_says_is_passed_on(monkeypatch, tmp_path):
    def pip(command, **options):
        return subprocess.CompletedProcess(command, 1, "", "note\nERROR: no such version\n")

    monkeypatch.setattr(peer_process.venv, "create", lambda *a, **k: None)
    monkeypatch.setattr(peer_process.subprocess, "run", pip)
    with pytest.raises(InputError, match=r"rotorpy.*no such version.*accepted: .*rotorpy==3"):
        peer_process.make_environment(tmp_path, "rotorpy", lambda text: None)
    assert peer_python(tmp_path, "rotorpy") is None


def test_a_simulator_that_does_not_start_says_why():
    with pytest.raises(InputError, match="rotorpy' ended: ModuleNotFoundError"):
        PeerProcess("rotorpy", Path(sys.executable), {})


@pytest.mark.slow
@pytest.mark.parametrize("name", PEERS)
def test_the_physics_of_the_others_agree(name):
    """Within 3 mm after 2 s of the same commands, 1.2 m from the start; all reach the goal."""
    python = peer_python(default_folder(), name)
    if python is None:
        pytest.skip(f"no environment of {name} here: python -m tombo_benchmarks.peers")
    result = _result()
    result.ends, result.replayed = {}, {}
    with PeerProcess(name, python, order(course_scenario())) as peer:
        compare_courses({name: peer}, result)
    assert result.replayed[name] < 0.003
    assert max(from_goal(result).values()) < 0.02

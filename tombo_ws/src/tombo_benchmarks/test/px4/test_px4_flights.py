"""`make test-px4`: its message without a PX4, and its table; the flights need a PX4."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tombo_benchmarks.px4.__main__ import main, markdown_table
from tombo_benchmarks.px4.lockstep_flight import fly_lockstep
from tombo_benchmarks.px4.lockstep_px4 import Px4Setup
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.node_flight import over_mavlink
from tombo_flight.suite.px4_connection import px4_connection


def test_without_a_px4_it_is_skipped_with_a_word(capsys):
    assert main([]) == 0
    assert "skipped: no PX4" in capsys.readouterr().out


def test_a_folder_without_a_px4_is_refused(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    assert "no PX4 SITL; accepted: PX4's source tree" in capsys.readouterr().err


@pytest.mark.slow
def test_over_px4_the_collision_is_recovered_from_as_in_the_headless_flight(tmp_path):
    scenario = load_scenario("paper_collision")
    headless = fly_scenario(scenario, 0).summary
    flown, _ = fly_lockstep(Px4Setup(None, tmp_path / "px4"), scenario)
    assert flown["recovery_time_s"] == pytest.approx(headless["recovery_time_s"], abs=0.5)
    assert flown["max_falling_distance_m"] < 0.85
    assert flown["estimate_error_max_m"] < 0.02
    assert flown["landed"] and flown["disarmed"]
    words = " ".join(text for _, text in flown["texts"])
    assert "Disarmed by landing" in words
    assert "fail-safe" not in words and "failure" not in words


def test_the_table_has_median_and_largest_of_each_kind_of_flight():
    hover = {"flight": "hover", "crashed": False, "landed": True, "missed": 0}
    found = [{**hover, "hover_rms_m": 1e-3 * mm} for mm in (30, 50, 40)]
    found.append({"flight": "collision", "crashed": True, "contacts": 3, "missed": 2})
    rows = markdown_table(found).splitlines()
    assert rows[0] == "|  | hover | collision |"
    assert "| crashed | 0 | 1 |" in rows
    assert "| landed | 3 | 0 |" in rows
    assert "| hit the pillar again | – | 1 |" in rows
    assert "| hover, RMS from the set point [mm] | 40, at most 50 | – |" in rows
    assert "| steps without an answer | 0 | 2 |" in rows


def test_what_nobody_has_measured_is_a_dash():
    rows = markdown_table([{"flight": "collision", "crashed": False, "landed": True}])
    assert "| hit the pillar again | – |" in rows
    assert "| steps without an answer | – |" in rows


@pytest.mark.parametrize("port", [4560, 4567])
def test_a_px4_whose_simulator_flies_along_has_it_in_the_suite(port):
    connection = replace(px4_connection("udpin://127.0.0.1:14540", []), hil_port=port)
    suite = over_mavlink(connection)
    assert suite["suite"]["sim"] == "tombo_px4.hil_sim_node"
    assert suite["without"] == () and suite["more"]["sim"] == {"port": port}

"""The script that plays the person types what the page of the first real flight says."""

from __future__ import annotations

import pytest

from tombo_benchmarks.px4.first_flight import PAGE, SCENARIO, VEHICLE, commands_of, scenario_of
from tombo_flight.scenario import load_scenario


def test_the_commands_are_those_of_the_page():
    page = PAGE.read_text(encoding="utf-8")
    (up,) = (c for c in commands_of(page, 3) if c.startswith("tombo up"))
    assert f" {SCENARIO} --vehicle {VEHICLE} --px4 " in up and "--without mission" in up
    assert [c.split()[3] for c in commands_of(page, 5)] == [
        "/px4/offboard",
        "/px4/arm",
        "/px4/kill",
    ]
    fly, diagnose = (c for c in commands_of(page, 6) if c.startswith("tombo "))
    # what flies is what step 2 has described
    assert f"tombo fly {SCENARIO} --vehicle {VEHICLE} --px4 " in fly
    assert f"--vehicle {VEHICLE}" in diagnose


def test_the_scenario_of_the_page_flies_within_its_net(tmp_path):
    (tmp_path / SCENARIO).write_text(scenario_of(PAGE.read_text(encoding="utf-8")))
    scenario = load_scenario(str(tmp_path / SCENARIO))
    assert scenario.mission.height < scenario.volume.z_max - scenario.volume.margin
    assert scenario.volume.x_max == 2.0 and scenario.safety.speed_max == 2.0


def test_a_page_without_the_step_is_seen():
    with pytest.raises(IndexError):
        commands_of(PAGE.read_text(encoding="utf-8"), 9)

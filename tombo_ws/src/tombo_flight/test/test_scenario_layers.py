"""What lies over what in a scenario: settings, a reaction by name, disturbances."""

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import (
    as_mapping,
    disturbances,
    extended_scenario,
    load_scenario,
    scenario_from_mapping,
)


def test_another_reaction_leaves_the_parameters_of_the_one_before():
    mine = {"extends": "paper_collision", "reaction": {"distance": 1.5}}
    assert extended_scenario(mine, "mine").reaction.distance == 1.5
    assert load_scenario("paper_collision", ["reaction.distance=1", "reaction.name=none"])
    with pytest.raises(InputError, match="distance"):
        load_scenario("paper_collision", ["reaction.name=none", "reaction.distance=1"])
    back = load_scenario("survey", ["reaction.name=bounce", "reaction.distance=1.5"])
    assert (back.reaction.name, back.reaction.distance) == ("bounce", 1.5)


def test_the_word_of_older_files_takes_the_reaction_away():
    assert load_scenario("paper_collision", ["react=false"]).reaction.name == "none"
    assert load_scenario("paper_collision", ["react=true"]).reaction.name == "bounce"


def test_disturbances_lie_below_what_is_said_beside_and_after_them():
    flown = disturbances()["effects"]["gusts"]
    plain = load_scenario("paper_collision")
    assert plain.effects["gusts"] != flown
    disturbed = load_scenario("paper_collision", ["disturbances=true"])
    assert disturbed.disturbances and disturbed.effects["gusts"]["deviation"] == flown["deviation"]
    assert (
        disturbed.effects.items()
        >= {
            key: value
            for key, value in plain.effects.items()
            if key not in disturbances()["effects"]
        }.items()
    )
    mine = {"extends": "paper_collision", "disturbances": True}
    assert extended_scenario(mine, "paper_collision") == disturbed
    mine["effects"] = {"gusts": {"deviation": 2.0}}
    changed = extended_scenario(mine, "paper_collision")
    assert changed.effects["gusts"]["deviation"] == 2.0
    after = ["disturbances=true", "effects.gusts.deviation=2"]
    assert load_scenario("paper_collision", after) == changed
    assert load_scenario("paper_collision", [*after, "disturbances=true"]) == changed
    assert scenario_from_mapping(as_mapping(changed), "paper_collision") == changed


@pytest.mark.slow
def test_disturbances_shake_the_imu_in_hover_and_change_from_flight_to_flight():
    scenario = load_scenario("hover", ["disturbances=true", "duration=14"])
    flights = [fly_scenario(scenario, seed) for seed in range(5000, 5003)]
    for record in flights:
        shaken = {}
        for name in ("gyro", "accel"):
            readings = record.log[name][8000:]
            shaken[name] = readings[20:-20] - _smooth(readings)
        assert np.sqrt(np.mean(shaken["gyro"] ** 2)) > 0.3  # rad/s, of each axis
        assert np.sqrt(np.mean(shaken["accel"] ** 2)) > 3.0  # m/s^2
    flown = [record.scenario["effects"] for record in flights]
    assert len({f["blade_strike"]["recovery_time"] for f in flown}) == 3
    assert all(np.hypot(*f["steady_wind"].values()) == pytest.approx(1.0) for f in flown)


def _smooth(readings):
    """Return the mean over 41 ms, which is without what turns with the rotors."""
    whole = np.cumsum(np.vstack([np.zeros(3), readings]), axis=0)
    return (whole[41:] - whole[:-41]) / 41.0

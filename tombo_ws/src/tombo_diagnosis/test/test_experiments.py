"""The separating manoeuvres: each can be flown, from a file, and does what it says."""

import numpy as np
import pytest

from tombo_diagnosis.flight.experiment_design import manoeuvre_catalogue, mission
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import extended_scenario

CATALOGUE = manoeuvre_catalogue()


@pytest.fixture(scope="module")
def records():
    return {
        name: fly_scenario(extended_scenario(m.scenario, name), 1) for name, m in CATALOGUE.items()
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", CATALOGUE)
def test_a_mission_takes_at_most_40_s_in_a_small_room_and_lands(records, name):
    record = records[name]
    scenario = extended_scenario(CATALOGUE[name].scenario, name)
    assert scenario.reaction.name == "none" and scenario.obstacle.radius == 0.0
    place = record.log["position"]
    assert record.summary["landed"] and not record.summary["crashed"]
    assert record.t[-1] < 40.0
    assert np.abs(place[:, :2]).max() < 2.0
    assert place[:, 2].max() < 3.0


def test_every_manoeuvre_says_how_it_is_done():
    assert len(CATALOGUE) >= 8
    for name, manoeuvre in CATALOGUE.items():
        assert manoeuvre.name == name
        assert manoeuvre.text.endswith(".") and len(manoeuvre.text) > 20


def during(record, column):
    return record.log[column][record.log["mode"][:, 0] == Phase.APPROACH]


@pytest.mark.slow
def test_missions_show_what_they_are_for(records):
    speeds = np.abs(during(records["three_speeds"], "velocity")[:, 0])
    assert all(((speeds > v - 0.1) & (speeds < v + 0.1)).sum() > 400 for v in (0.7, 1.4, 2.4))
    heights = during(records["two_heights"], "position")[:, 2]
    assert (heights < 0.45).sum() > 7000 and (heights > 2.1).sum() > 7000
    x, y, z, w = during(records["turn_in_hover"], "attitude").T
    turned = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    assert turned[-1] - turned[0] == pytest.approx(4 * np.pi, abs=0.2)
    assert np.abs(during(records["turn_in_hover"], "velocity")).max() < 0.2
    assert np.abs(during(records["yaw_steps"], "rates")[:, 2]).max() > 1.3
    assert np.abs(during(records["rate_steps"], "rates")[:, :2]).max(axis=0).min() > 3.0
    assert np.ptp(during(records["square"], "position")[:, :2], axis=0).min() > 1.9
    assert np.abs(during(records["long_hover"], "velocity")).max() < 0.2
    climbs = during(records["climb_and_descend"], "velocity")[:, 2]
    assert climbs.max() > 1.4 and climbs.min() < -1.4
    both = during(records["both_ways"], "velocity")
    assert (both.max(axis=0)[:2] > 1.3).all() and (both.min(axis=0)[:2] < -1.3).all()


def test_a_mission_of_one_s_own_is_checked_like_any_scenario():
    with pytest.raises(InputError, match=r"mission.course\[0\].speed"):
        extended_scenario(mission("mine", "too fast.", [{"x": 9.0, "speed": 9.0}]), "mine")

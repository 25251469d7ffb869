"""The experiment that is proposed tells apart what the flights at hand can't, and it flies."""

from dataclasses import replace

import numpy as np
import pytest

from tombo_diagnosis.flight.analyse import analyse
from tombo_diagnosis.flight.experiment_design import as_log, manoeuvre_catalogue, separate
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_flight.flight import fly_scenario
from tombo_flight.progress import no_progress
from tombo_flight.scenario import extended_scenario, scenario_over

pytestmark = pytest.mark.slow

DOUBT = {"steady_wind": {"east": 1.0}, "mocap_misalignment": {"pitch": 0.02}}
"""Without an IMU, slowly and at one heading, the one is as the other."""
SLOW = {
    "reaction": {"name": "none"},
    "duration": 20.0,
    "mission": {
        "takeoff_time": 0.3, "height": 1.2, "climb_speed": 1.2, "approach_time": 2.2,
        "land_time": 3000.0,
        "course": [{"x": 0.4, "speed": 0.5, "acceleration": 1.0}, {"y": 0.4}, {"x": -0.4},
                   {"y": -0.4}, {"x": 0.0}],
    },
}  # fmt: skip


def with_effect(name):
    own = nominal_model().effects
    return {**own, name: {**own.get(name, {}), **DOUBT[name]}}


def flown(values, name, seed):
    effects = {k: dict(v) for k, v in with_effect(name).items()}
    make = extended_scenario if "extends" in values else scenario_over
    return fly_scenario(make({**values, "effects": effects}, "separation"), seed)


def analysed(values, name, seed=1):
    logs = [as_log(flown(values, name, seed + k), imu=False, rpm=False) for k in range(2)]
    tracks = [track_of(replace(log, name=f"flight {k}")) for k, log in enumerate(logs)]
    return analyse(tracks, nominal_model())


@pytest.fixture(scope="module")
def doubtful():
    return analysed(SLOW, "steady_wind", seed=21)


@pytest.fixture(scope="module")
def proposed(doubtful):
    assert set(DOUBT) <= set(doubtful.judgement.members)
    return separate(doubtful, no_progress)


def test_what_is_proposed_promises_more_than_the_flights_at_hand(proposed):
    assert set(DOUBT) <= set(proposed.effects)
    assert proposed.separation > 5.0 > abs(proposed.present)
    assert proposed.mission in [m.scenario for m in manoeuvre_catalogue().values()]
    assert "wind" in proposed.text


@pytest.mark.parametrize("true", DOUBT)
def test_flown_it_tells_them_apart(proposed, true):
    words = analysed(proposed.mission, true, seed=50).judgement
    assert words.verdict == "named" and words.effects[0] == true


def test_it_flies_and_lands(proposed):
    record = flown(proposed.mission, "steady_wind", 9)
    assert record.summary["landed"] and not record.summary["crashed"]


def test_without_a_set_nothing_is_proposed(doubtful):
    sure = replace(doubtful, judgement=replace(doubtful.judgement, members=()))
    assert separate(sure, no_progress) is None


def test_for_an_unknown_vehicle_the_experiment_is_given_in_words(doubtful):
    other = replace(nominal_model(), calibrated=True)
    doubtful.problem.nominal, own = other, doubtful.problem.nominal
    try:
        words = separate(doubtful, no_progress)
    finally:
        doubtful.problem.nominal = own
    assert not words.mission and np.isnan(words.separation) and "wind" in words.text


def test_on_the_ground_is_no_flight():
    record = flown(SLOW, "steady_wind", 1)
    log = as_log(record, imu=True, rpm=True)
    assert {"gyro", "accel", "rotor_speed"} <= set(log.series)
    track = track_of(log)
    used = track.slow.t[track.slow_rows]
    height = np.interp(used, record.t, record.log["position"][:, 2])
    assert height.min() > 0.25

"""The whole analysis on simulated flights: healthy, unknown, named, or inconclusive."""

from dataclasses import replace

import numpy as np
import pytest
from measured_flights import nominal, tracks, with_hidden

from tombo_diagnosis.flight.analyse import analyse

pytestmark = pytest.mark.slow

"""What flights at one heading without an IMU can't tell apart."""


def judgement_of(*args, **more):
    return analyse(tracks(*args, **more), nominal()).judgement


@pytest.mark.parametrize("sensors", ["mocap", "imu"])
def test_healthy_vehicles_with_scattered_propellers_give_no_cause(sensors):
    rough = {"thrust_scatter": {"deviation": 0.1}}
    flights = [
        tracks(rough, seed, count=1, sensors=sensors, draws=np.roll([1.0, -1.0, 0, 0] * 2, seed))
        for seed in (1, 2)
    ]
    model = replace(nominal(), effects=with_hidden(rough))
    findings = analyse([track for own in flights for track in own], model)
    assert findings.problem.vehicles == 2
    assert findings.judgement.verdict == "none"
    same = analyse(tracks(rough, sensors=sensors), model)
    assert same.problem.vehicles == 1 and same.judgement.verdict == "none"


@pytest.mark.parametrize("unknown,sensors", [("tether", "imu_rpm"), ("thrust_fade", "mocap_rpm")])
def test_forces_of_no_effect_get_no_name(unknown, sensors):
    words = judgement_of(disturbance=(unknown,), sensors=sensors, seed=2)
    assert words.verdict == "unknown" and not words.effects and not words.members


def test_a_cause_beside_an_unknown_force_is_not_all_of_it():
    """The gate: the wind is there, but the flights are not explained by it."""
    words = judgement_of({"steady_wind": {"east": 1.5}}, disturbance=("yaw_spring",))
    assert words.verdict in ("partly_explained", "unknown")


def test_the_analysis_is_the_same_each_time_and_tells_how_far_it_is():
    shares = []
    flights = tracks({"steady_wind": {"east": 1.5}}, count=1)
    one = analyse(flights, nominal(), lambda stage, share: shares.append(share))
    other = analyse(flights, nominal())
    assert one.judgement == other.judgement
    assert np.array_equal(one.search.best.fit.theta, other.search.best.fit.theta)
    assert shares == sorted(shares) and 0.0 <= shares[0] < shares[-1] <= 1.0

"""Sound flights raise no alarm, at any rate and with any channels."""

import pytest
from made_flight import made_flight, poses_only, recorded

from tombo_logs.checks import check_log


def complaints(log):
    """Return the findings; that a channel is absent is said of every log without it."""
    said = [f for f in log.findings if f.check != "missing"]
    return [f.message for f in said if f.severity != "info" or f.check == "frame"]


@pytest.mark.parametrize("rate", [30.0, 100.0, 240.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_sound_flight(rate, seed):
    flight = made_flight(mocap_hz=rate, seed=seed)
    checked = check_log(flight)
    assert not complaints(checked)
    assert set(checked.series) == set(flight.series)
    assert len(checked.exclude) == 2  # before take-off, after landing
    assert not complaints(check_log(poses_only(flight)))


@pytest.mark.parametrize("width", [0.0, 0.05, 1.6])
def test_hovering_and_fast_ones(width):
    flight = made_flight(width=width, seed=3)
    assert not complaints(check_log(flight))
    assert not complaints(check_log(poses_only(flight)))


def test_one_without_noise():
    """Made data are smooth and stand still exactly: neither is frozen or interpolated."""
    assert not complaints(check_log(made_flight(noise=0.0)))


@pytest.mark.parametrize("name", ["no_obstacle_1", "aggressive_2"])
def test_simulated_ones_without_obstacle(name):
    checks = {f.check for f in check_log(recorded(name)).findings if f.severity != "info"}
    assert checks <= {"gap", "missing"}

"""What differs from flight to flight, beyond the start: only where it is asked for."""

import dataclasses
import math

import numpy as np
import pytest

from tombo_sim.flight_setup import begin
from tombo_sim.world import SpreadParams, World

SEEDS = range(300)
WORLD = World(effects={"steady_wind": {"east": 2.0}, "motor_lag": {"extra_tau": 0.004}})
SPREAD = SpreadParams(recovery_time=0.4, motor_lag=0.3, wind=1.5, mocap_rate=100.0)


@pytest.fixture(scope="module")
def setups():
    spread = dataclasses.replace(WORLD, spread=SPREAD)
    return [(begin(WORLD, seed), begin(spread, seed)) for seed in SEEDS]


def uniform(values, half_width):
    """Return whether values are spread evenly over +- half_width, within their sampling error."""
    shares = (np.sort(values) / half_width + 1.0) / 2.0
    even = (np.arange(len(values)) + 0.5) / len(values)
    return float(np.abs(shares - even).max()) < 1.63 / math.sqrt(len(values))  # Kolmogorov, 1 %


def test_recovery_and_motor_lag_are_uniform_about_their_nominal_values(setups):
    nominal = setups[0][0].effects["blade_strike"]["recovery_time"]
    recovery = [s.effects["blade_strike"]["recovery_time"] / nominal - 1.0 for _, s in setups]
    lag = [s.plant.motor_time_constant - p.plant.motor_time_constant for p, s in setups]
    assert uniform(recovery, 0.4)
    assert uniform(lag, 0.3 * WORLD.vehicle.motor_time_constant)
    assert abs(np.corrcoef(recovery, lag)[0, 1]) < 0.15


def test_spread_wind_of_one_speed_is_added_in_any_direction(setups):
    wind = np.array([(s.effects["steady_wind"]["east"], s.effects["steady_wind"]["north"])
                     for _, s in setups]) - [2.0, 0.0]  # fmt: skip
    assert np.hypot(*wind.T) == pytest.approx(1.5)
    assert uniform(np.arctan2(wind[:, 1], wind[:, 0]), math.pi)


def test_half_of_the_flights_have_the_other_motion_capture(setups):
    rates = [s.mocap_rate for _, s in setups]
    assert set(rates) == {30.0, 100.0}
    assert 0.4 < rates.count(100.0) / len(rates) < 0.6
    assert {p.mocap_rate for p, _ in setups} == {30.0}


def test_nothing_else_is_drawn_differently(setups):
    for plain, spread in setups[:5]:
        assert (plain.start == spread.start).all() and plain.obstacle == spread.obstacle
        assert (plain.plant.draws == spread.plant.draws).all()
        for name in ("tick_noise", "mocap_noise"):
            one, other = getattr(plain, name), getattr(spread, name)
            assert (one.standard_normal(8) == other.standard_normal(8)).all()

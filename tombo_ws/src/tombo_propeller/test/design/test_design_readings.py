"""Prediction of what was measured: the mean unless something is better than chance."""

import dataclasses

import numpy as np
import pytest

from tombo_dynamics.propeller import Configuration, configuration, configurations
from tombo_propeller.design.request import MEASURED
from tombo_propeller.design.response_regression import (
    FEWEST,
    MEAN,
    flap_stiffness,
    left_out_errors,
    read,
)

SOFT = [c for c in configurations() if c.measured and c.nodus]


def with_forces(forces) -> list[Configuration]:
    return [
        dataclasses.replace(
            c, measured=dataclasses.replace(c.measured, collision_force_N=float(force))
        )
        for c, force in zip(SOFT, forces, strict=True)
    ]


@pytest.mark.parametrize("name", MEASURED)
def test_nothing_beats_the_mean_on_the_papers_nine_readings(name):
    reading = read(name, configurations())
    assert reading.count == 9
    assert reading.regressor == MEAN
    assert reading.chance > 0.1
    assert reading.predict(configuration(2))[0] == pytest.approx(reading.mean)


def test_errors_left_out_are_those_of_fits_without_the_point():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=8), rng.normal(size=8)
    design = np.column_stack([np.ones(8), x])
    for i, error in enumerate(left_out_errors(design, y)):
        rest = np.arange(8) != i
        fit = np.polyfit(x[rest], y[rest], 1)
        assert error == pytest.approx(y[i] - np.polyval(fit, x[i]))


def test_a_law_in_the_readings_is_found_and_used():
    stiffness = np.array([flap_stiffness(c) for c in SOFT])
    noise = np.random.default_rng(2).normal(size=9)
    reading = read("collision_force_N", with_forces(50.0 + 400.0 * stiffness + noise))
    assert "stiffness" in reading.regressor
    value, error = reading.predict(configuration(3))
    assert value == pytest.approx(50.0 + 400.0 * flap_stiffness(configuration(3)), abs=4.0)
    assert 0.0 < error < 4.0
    farther = dataclasses.replace(
        configuration(3), nodus=dataclasses.replace(configuration(3).nodus, length_mm=4.0)
    )
    assert reading.predict(farther)[1] > 1.5 * error  # extrapolation costs certainty


@pytest.mark.slow
def test_readings_without_a_law_seldom_get_one_and_bounds_hold():
    rng = np.random.default_rng(3)
    accepted, within = 0, 0
    for _ in range(150):
        reading = read("collision_force_N", with_forces(rng.normal(120.0, 30.0, 9)))
        accepted += reading.regressor != MEAN
        value, error = reading.predict(configuration(2))
        within += rng.normal(120.0, 30.0) <= value + error * reading.quantile(0.9)
    assert accepted <= 16  # 5 % of 150, and three standard errors
    assert 0.82 <= within / 150 <= 0.97


def test_too_few_readings_predict_nothing():
    reading = read("recovery_s", SOFT[: FEWEST - 1])
    assert np.isnan(reading.predict(configuration(2))).all()

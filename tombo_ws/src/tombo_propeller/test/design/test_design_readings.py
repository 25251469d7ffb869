"""The mean of the readings as a prediction, and the interval of the next reading."""

import dataclasses

import numpy as np
import pytest

from tombo_dynamics.propeller import configurations
from tombo_propeller.design.readings import read

SOFT = [c for c in configurations() if c.measured and c.nodus]


def with_forces(forces):
    return [
        dataclasses.replace(
            c, measured=dataclasses.replace(c.measured, collision_force_N=float(force))
        )
        for c, force in zip(SOFT, forces, strict=True)
    ]


def test_the_error_is_that_of_the_mean_of_the_others():
    forces = np.array([c.measured.collision_force_N for c in SOFT])
    others = [np.delete(forces, i).mean() for i in range(forces.size)]
    reading = read("collision_force_N", SOFT)
    assert reading.count == 9
    assert reading.error == pytest.approx(np.sqrt(np.mean((forces - others) ** 2)))


@pytest.mark.slow
def test_the_next_reading_keeps_the_bound_with_its_probability():
    rng = np.random.default_rng(3)
    within = 0
    for _ in range(300):
        reading = read("collision_force_N", with_forces(rng.normal(120.0, 30.0, 9)))
        within += rng.normal(120.0, 30.0) <= reading.mean + reading.reach(0.9)
    assert within / 300 == pytest.approx(0.9, abs=0.05)

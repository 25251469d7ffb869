"""A vehicle from gyro, accelerometer and commands: what made a flight is found again."""

import numpy as np
import pytest

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.flight.fit.inertial_fit import fit_inertial, inertial_flight
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import ARM_X, ARM_Y

pytestmark = pytest.mark.slow

MASS, ARM, LAG = 0.03, 0.05, 0.05
INERTIA = np.array([1.5e-5, 2.0e-5])
OFFSET, CURVATURE = 0.02, 0.12


def fly_log(seed, noise=1.0):
    """A flight whose commands are drawn; its rates are kept small by a weak damping."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 25.0, 0.001)
    slow = np.repeat(rng.standard_normal((t.size // 100, 4)), 100, axis=0)
    command = 0.65 + 0.03 * slow
    rotor, rates, force = command[0].copy(), np.zeros((t.size, 3)), np.zeros(t.size)
    for k in range(t.size):
        rotor += (command[k] - rotor) * (1.0 - np.exp(-0.001 / LAG))
        thrust = OFFSET + CURVATURE * rotor**2
        force[k] = thrust.sum() / MASS
        if k:
            moment = ARM * np.array([thrust @ ARM_Y, -(thrust @ ARM_X)])
            rates[k, :2] = rates[k - 1, :2] + 0.001 * moment / INERTIA
    accel = np.column_stack([0.0 * t, 0.0 * t, force]) + noise * rng.standard_normal((t.size, 3))
    gyro = rates + 0.02 * noise * rng.standard_normal((t.size, 3))
    series = {"gyro": gyro, "accel": accel, "motor_command": command}
    return Flight.measured("made", "made", {k: Series(t, v) for k, v in series.items()})


def test_lag_thrust_and_inertia_are_found_again():
    flights = [inertial_flight(fly_log(seed)) for seed in (0, 1)]
    fit = fit_inertial(flights, MASS, ARM)
    assert fit.lag + fit.delay == pytest.approx(LAG, rel=0.1)
    assert fit.inertia == pytest.approx(INERTIA, rel=0.05)
    assert (fit.bounds[:, 0] < INERTIA).all() and (fit.bounds[:, 1] > 0.97 * INERTIA).all()
    thrust = fit.drive.thrust(np.full((1, 4), 0.65))[0, 0]
    assert thrust == pytest.approx(OFFSET + CURVATURE * 0.65**2, rel=0.01)


def test_what_is_missing_is_said():
    log = fly_log(0)
    short = log.with_series({k: s for k, s in log.series.items() if k != "accel"})
    with pytest.raises(InputError, match="no accel; without poses needed: gyro, accel"):
        inertial_flight(short)

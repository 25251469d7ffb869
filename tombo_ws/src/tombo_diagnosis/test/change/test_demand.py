"""A flight's features of demand: the same in a hover and in manoeuvres, shaken or not."""

import numpy as np
import pytest

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.change.features import airborne, features
from tombo_diagnosis.flight.fit.drive_curve import DriveCurve
from tombo_dynamics.vehicle import GRAVITY

T = np.arange(0.0, 20.0, 0.01)
SHARES = np.array([1.1, 0.9, 1.0, 1.0])
"""Of the four rotors."""


def flight(turn, vibration, mass=1.0):
    """A circle at constant height with `turn` [m/s^2], commands in proportion to thrust."""
    rng, rate = np.random.default_rng(4), 3.0
    circle = np.column_stack([np.cos(rate * T), np.sin(rate * T), 0.0 * T])
    thrust = np.hypot(1.0, turn / GRAVITY)
    command = 0.5 * mass * thrust * SHARES + 0.0 * T[:, None]
    measured = -turn * circle
    measured[:, 2] += vibration * rng.standard_normal(T.size)
    place = turn / rate**2 * circle + [0.0, 0.0, 2.0]
    channels = {"position": place, "acceleration": measured, "motor_command": command}
    return airborne(Flight.measured("f", "", {n: Series(T, v) for n, v in channels.items()}))


@pytest.mark.parametrize(("turn", "vibration"), [(0.0, 0.0), (5.0, 0.0), (5.0, 1.0)])
def test_manoeuvres_and_vibration_do_not_change_the_demand(turn, vibration):
    curve = DriveCurve(2.0, 1.0, 0.0, (0.1, 0.1))
    found = features(flight(turn, vibration, mass=1.2), curve).demand
    assert found == pytest.approx(np.log(1.2 * SHARES), abs=0.01)

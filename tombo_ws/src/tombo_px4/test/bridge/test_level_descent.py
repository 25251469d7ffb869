"""A descent by thrust ends where the ground carries the vehicle, and not before."""

import numpy as np
import pytest

from tombo_control.safety.params import SafetyParams
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.level_descent import PERIOD_NS, LevelDescent

LEVEL, REST = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
HOVER = 0.5


@pytest.mark.parametrize("on_ground", [True, False])
def test_only_the_ground_carries_a_vehicle_whose_rotors_give_less(on_ground):
    descent, climb = LevelDescent(1.3, SafetyParams()), 0.0
    for k in range(300):
        velocity = np.array([0.0, 0.0, climb])
        _, throttle = descent.step(k * PERIOD_NS, LEVEL, velocity, HOVER)
        lift = GRAVITY * throttle / HOVER
        force = max(lift, GRAVITY) if on_ground else lift
        climb = 0.0 if on_ground else climb + (lift - GRAVITY) * PERIOD_NS * 1e-9
        descent.feel(REST, np.array([0.0, 0.0, force]), PERIOD_NS * 1e-9)
    assert descent.touched == on_ground

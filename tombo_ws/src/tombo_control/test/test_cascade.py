"""The cascade as a whole: its rates, what damps, standing by, mocap lost and back."""

import math

import numpy as np
import pytest
from control_bench import bench, fresh_autopilot, quaternion, rotor_table

from tombo_control.loops.cascade import cascade
from tombo_control.params import ControlParams
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import tilt

C = ControlParams()


@pytest.mark.parametrize("mode", [Phase.IDLE, Phase.LANDED])
def test_stands_by_with_rotors_off_and_integrals_forgotten(mode):
    a = fresh_autopilot()
    a.setpoint.position[:] = 3.0, 3.0, 13.0
    a.state.rates[:] = 0.1, -0.2, 0.3
    for tick in range(500):
        a.leg.start[:] = 0.3, -0.3, 10.3
        cascade(a, rotor_table(), tick)
    assert np.abs(a.loops.velocity_integral).min() > 0.0
    assert np.abs(a.loops.rate_integral).min() > 0.0
    a.mode_asked = mode
    cascade(a, rotor_table(), 501)
    assert (a.setpoint.rotor_speed == 0.0).all()
    assert (a.loops.velocity_integral == 0.0).all()
    assert (a.loops.rate_integral == 0.0).all()
    assert a.mode_flown == mode
    # so the derivative of the first tick in the air starts from the present rate
    assert (a.loops.rate_filtered == a.state.rates).all()


def test_saturated_command_brings_it_back_from_a_tumble():
    """Dropped upside down with a spin: it levels and holds, with no rotor past its limits."""
    b = bench()
    b.plant.state.position[2] = 30.0
    b.a.leg.start[2] = 30.0
    b.plant.state.attitude = quaternion((1.0, 0.3, 0.0), math.pi - 0.01)
    b.plant.state.rates = [3.0, -2.0, 1.0]
    body = b.fly(15.0)
    assert tilt(body[-1, 6:10]) < 0.02
    assert np.linalg.norm(body[-1, :3] - [0.0, 0.0, 30.0]) < 0.1
    assert body[:, 2].min() > 15.0

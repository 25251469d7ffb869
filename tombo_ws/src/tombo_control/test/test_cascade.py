"""The cascade as a whole: its rates, what damps, standing by, mocap lost and back."""

import math

import numpy as np
import pytest
from control_bench import bench, fresh_autopilot, quaternion, rotor_table

from tombo_control.loops.cascade import cascade
from tombo_control.loops.position_control import BLIND_SPEED
from tombo_control.params import ControlParams
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import tilt, yaw_pitch_roll

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


@pytest.mark.slow
def test_levels_and_sinks_without_mocap_and_comes_back():
    b = bench()
    b.plant.state.velocity = [1.0, 0.5, 0.0]
    b.plant.state.attitude = quaternion((0.6, -0.8, 0.0), 0.4)
    heading = yaw_pitch_roll(b.plant.state.attitude)[0]

    def stale(a, tick):
        a.mocap_time = tick * 1e-3 - (C.blind_timeout + 0.001)
        cascade(a, rotor_table(), tick)

    body = b.fly_ticks(3.0, stale)
    assert b.a.mode_flown == Phase.DESCEND_BLIND
    assert tilt(body[2500:, 6:10]).max() < 0.02
    assert np.allclose(body[1500:, 5], -BLIND_SPEED, atol=0.05)
    assert np.abs(body[2500:, 3:5]).max() < 0.1, "the speed it had is braked"
    assert abs(yaw_pitch_roll(body[-1, 6:10])[0] - heading) < 0.05

    def fresh(a, tick):
        a.mocap_time = tick * 1e-3 - (C.blind_timeout - 0.001)
        cascade(a, rotor_table(), tick)

    body = b.fly_ticks(20.0, fresh)
    assert b.a.mode_flown == Phase.HOVER
    assert tilt(body[:, 6:10]).max() < C.tilt_max + 0.1
    assert np.linalg.norm(body[-1, :3] - [0.0, 0.0, 10.0]) < 0.05


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

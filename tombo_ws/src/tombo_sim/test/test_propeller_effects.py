"""The strike of a vehicle's propeller: that of the paper's, by spin momentum over radius."""

import math

import pytest

from tombo_dynamics.propeller.mounted_propeller import PropellerChoice
from tombo_dynamics.vehicle import GRAVITY, VehicleParams
from tombo_sim.propeller_effects import vehicle_effects

PAPER = VehicleParams()
HOVER_RAD_S, RIGID_N = 512.0, 269.3
"""Of the paper: speed of its rotors in hover, push of its rigid propeller."""


@pytest.mark.parametrize(("radius", "inertia"), [(0.7, 0.5), (0.9, 0.4), (0.7, 0.3)])
def test_a_plain_propeller_pushes_by_its_spin_momentum_over_its_radius(radius, inertia):
    vehicle = VehicleParams(
        mass=0.8,
        rotor_radius=radius * PAPER.rotor_radius,
        rotor_inertia=inertia * PAPER.rotor_inertia,
    )
    k_thrust = 6e-6
    speed = math.sqrt(vehicle.mass * GRAVITY / (4.0 * k_thrust))
    propeller = PropellerChoice(k_thrust=k_thrust, k_torque=1e-7)
    strike = vehicle_effects(propeller, vehicle, {})["blade_strike"]
    push = RIGID_N * inertia * speed / HOVER_RAD_S / radius
    assert strike["peak_force"] == pytest.approx(push, rel=0.01)
    assert strike["recovery_time"] == 0.0  # it does not fold

"""Gains for other vehicles: the margins of the default cascade, whatever the vehicle."""

import dataclasses
import math

import pytest
from loop_analysis import cascade_margins

from tombo_control.loops.loop_design import gains_for
from tombo_control.params import ControlParams
from tombo_dynamics.params import validate
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, thrust_map_of
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_dynamics.vehicle import VehicleParams, similar_vehicle


def vehicle_of(mass, arm, lag, rotor=1.0):
    """Return a vehicle with plain propellers that hovers at half of its highest thrust."""
    radius = 0.46 * arm
    speed = 512.0 * 0.1111 / radius  # equal tip speed
    k = mass * 9.80665 / 4.0 / speed**2
    choice = PropellerChoice(k_thrust=k, k_torque=0.2 * radius * k, radius=radius)
    vehicle = dataclasses.replace(
        similar_vehicle(mass, arm, radius, speed), motor_time_constant=lag
    )
    vehicle = dataclasses.replace(vehicle, rotor_inertia=rotor * vehicle.rotor_inertia)
    return vehicle, rotor_maps(thrust_map_of(choice), vehicle)


def test_the_default_vehicle_has_the_default_gains():
    vehicle = VehicleParams()
    assert gains_for(vehicle, rotor_maps(thrust_map_of(PropellerChoice()), vehicle)) == (
        ControlParams()
    )


@pytest.mark.parametrize("rotor", [0.3, 3.0])
@pytest.mark.parametrize("lag", [0.01, 0.035, 0.08, 0.15])
@pytest.mark.parametrize(("mass", "arm"), [(0.02, 0.04), (0.3, 0.08), (1.5, 0.24), (10.0, 0.6)])
def test_every_loop_keeps_its_margins(mass, arm, lag, rotor):
    vehicle, maps = vehicle_of(mass, arm, lag, rotor)
    gains = gains_for(vehicle, maps)
    validate(gains, "control")
    designed = cascade_margins(gains, vehicle, maps)
    for name, margin in designed.items():
        assert margin.phase_margin > math.radians(55.0), name
        assert margin.gain_margin_db > 10.0, name
    # Where rotors are heavy and motors fast the loop's gain hardly falls about its crossover.
    assert designed["yaw_rate"].crossover == pytest.approx(13.1 * min(1.0, 0.035 / lag), rel=0.2)


def test_slow_motors_need_the_rule():
    vehicle, maps = vehicle_of(0.04, 0.05, 0.15)
    kept = cascade_margins(ControlParams(), vehicle, maps)
    assert min(m.phase_margin for m in kept.values()) < math.radians(35.0)

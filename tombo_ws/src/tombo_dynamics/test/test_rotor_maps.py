"""The rotor's table that simulator and controller share: faithful, monotone, invertible."""

import dataclasses

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import configuration, thrust_map
from tombo_dynamics.rotor_maps import rotor_maps, rotor_thrust, rotor_torque, speed_for_thrust
from tombo_dynamics.vehicle import VehicleParams

PROPELLERS = [(0, "repaired"), (3, "repaired"), (13, "repaired"), (13, "consistent"),
              (13, "published")]  # fmt: skip


@pytest.fixture(params=PROPELLERS, ids=lambda p: f"conf{p[0]}-{p[1]}", scope="module")
def propeller(request):
    conf, law = request.param
    source = thrust_map(configuration(conf), law=law)
    return source, rotor_maps(source, VehicleParams())


def top_speed(source):
    return min(source.omega_max, VehicleParams().rotor_speed_max)


def test_table_gives_the_propellers_thrust_and_torque(propeller):
    source, table = propeller
    for speed in np.linspace(0.0, top_speed(source), 501):
        assert rotor_thrust(table, speed) == pytest.approx(float(source.thrust(speed)), abs=2e-3)
        assert rotor_torque(table, speed) == pytest.approx(float(source.torque(speed)), abs=1e-4)


def test_more_speed_is_more_thrust_and_more_torque(propeller):
    source, table = propeller
    speeds = np.linspace(5.0, top_speed(source), 2000)
    assert (np.diff([rotor_thrust(table, s) for s in speeds]) > 0.0).all()
    assert (np.diff([rotor_torque(table, s) for s in speeds]) > 0.0).all()


def test_speed_for_a_thrust_gives_that_thrust(propeller):
    _, table = propeller
    highest = table.thrust_highest
    for thrust in np.linspace(0.02 * highest, highest, 400):
        back = rotor_thrust(table, speed_for_thrust(table, thrust))
        assert back == pytest.approx(thrust, rel=1e-3)


def test_the_drives_limit_cuts_the_table():
    slow = VehicleParams(rotor_speed_max=600.0)
    table = rotor_maps(thrust_map(configuration(13)), slow)
    assert speed_for_thrust(table, 1e3) == pytest.approx(600.0)
    assert table.thrust_highest == pytest.approx(
        float(thrust_map(configuration(13)).thrust(600.0))
    )


@pytest.mark.parametrize("conf", [1, 5])
def test_a_propeller_that_cannot_lift_the_vehicle_is_refused(conf):
    source = thrust_map(configuration(conf))
    with pytest.raises(InputError) as caught:
        rotor_maps(source, VehicleParams())
    message = str(caught.value)
    assert "propeller.conf" in message and "vehicle.mass 1.3 kg" in message
    assert "\n" not in message
    light = VehicleParams(mass=0.2)
    assert speed_for_thrust(rotor_maps(source, light), light.hover_thrust()) > 0.0


@pytest.mark.parametrize("lowest, highest", [(900.0, 820.0), (650.0, 640.0), (560.0, 820.0)])
def test_an_idle_speed_that_already_lifts_is_refused(lowest, highest):
    """Idling rotors would carry the vehicle away, or idle faster than at full power."""
    vehicle = dataclasses.replace(VehicleParams(), rotor_speed_min=lowest, rotor_speed_max=highest)
    with pytest.raises(InputError, match=r"rotor_speed_min"):
        rotor_maps(thrust_map(configuration(13)), vehicle)

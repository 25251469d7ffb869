"""Fixtures of the model's tests; makes its modules importable: test folders are not packages."""

import one_vehicle
import pytest

from tombo_dynamics.vehicle import VehicleParams


@pytest.fixture(scope="session")
def vehicle():
    return VehicleParams()


@pytest.fixture(scope="session")
def maps():
    """Return the rotor's table of the paper's propeller, Conf. 13."""
    return one_vehicle.tombo_maps()


@pytest.fixture(scope="session")
def no_air():
    """Return a rotor's table without thrust and torque: rotors that spin in a vacuum."""
    return one_vehicle.vacuum_maps()

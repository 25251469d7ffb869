"""The floor carries, brakes and rubs; it never pulls and never gives energy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_vehicle import Vehicle, random_attitude
from scipy.spatial.transform import Rotation

from tombo_dynamics.vehicle import GRAVITY, VehicleParams

WIDE = VehicleParams(leg_spread=0.4, arm_length=0.1, leg_height=0.1)


def standing(params=None, **more):
    """Return a vehicle whose legs just touch the floor."""
    params = params or VehicleParams()
    return Vehicle(params=params, position=(0.0, 0.0, params.leg_height), **more)


def test_legs_carry_the_weight(vehicle):
    v = standing()
    v.fly(2.0)
    v.begin()
    weight = v.mass * GRAVITY
    assert v.wrench == pytest.approx([0.0, 0.0, weight, 0.0, 0.0, 0.0], abs=1e-6)
    sag = vehicle.leg_height - v.position[2]
    assert sag == pytest.approx(weight / (4.0 * vehicle.ground_stiffness), rel=1e-6)


def test_a_vehicle_on_its_back_lies_on_its_motors(vehicle):
    v = Vehicle(position=(0.0, 0.0, 0.05), attitude=(1.0, 0.0, 0.0, 0.0))
    v.fly(3.0)
    sag = v.mass * GRAVITY / (4.0 * vehicle.ground_stiffness)
    assert v.position[2] == pytest.approx(vehicle.rotor_height - sag, abs=1e-6)
    assert np.abs(v.velocity).max() < 1e-9


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_friction_stops_a_sliding_vehicle_in_the_distance_of_coulomb(vehicle, speed):
    """Low friction, so that the vehicle slides flat and does not stumble over its legs."""
    params = VehicleParams(friction=0.2)
    heading = Rotation.from_euler("z", 0.5)
    v = standing(params, velocity=heading.apply([speed, 0.0, 0.0]))
    path = v.fly(3.0, watch=lambda v: heading.inv().apply(v.plant.state.position))
    expected = speed**2 / (2.0 * 0.2 * GRAVITY)
    assert path[-1, 0] == pytest.approx(expected, rel=0.25)
    assert np.diff(path[:, 0]).min() > -1e-5  # it does not come back
    assert np.abs(path[:, 1]).max() < 0.01 * expected
    assert np.abs(v.velocity).max() < 1e-3


def test_the_floor_only_pushes():
    """Legs below the floor and rising fast: damping would pull, the floor does not."""
    v = standing()
    v.position[2] -= 0.003
    v.velocity[2] = 3.0
    v.begin()
    assert v.wrench == pytest.approx(np.zeros(6), abs=1e-12)
    v.velocity[2] = -3.0
    v.begin()
    assert v.plant.force[2] > 4 * 0.003 * v.params.ground_stiffness


@pytest.mark.slow
@settings(max_examples=40)
@given(st.integers(0, 10_000), st.sampled_from([VehicleParams(), WIDE]))
def test_a_fall_ends_with_less_energy_than_it_began(seed, params):
    """From any attitude, tumbling or not; springs may hold some in between, never more."""
    rng = np.random.default_rng(seed)
    v = Vehicle(
        params=params, position=(0.0, 0.0, rng.uniform(0.45, 1.0)), velocity=rng.normal(0, 2, 3),
        attitude=random_attitude(rng), rates=rng.normal(0.0, 4.0, 3),
    )  # fmt: skip
    before = v.energy()
    seen = v.fly(1.5, watch=Vehicle.energy)
    assert np.isfinite(seen).all()
    assert seen.max() <= before + 1e-9
    assert v.energy() < 0.7 * before

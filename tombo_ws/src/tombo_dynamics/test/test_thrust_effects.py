"""What changes thrust, mass and balance: coefficient, weak propellers, scatter, floor, cargo."""

import numpy as np
import pytest
from one_vehicle import Vehicle, hover_speed

from tombo_dynamics.vehicle import ROTOR_NAMES, SPIN


def hovering(effects, height=10.0, **more):
    v = Vehicle(effects, position=(0.0, 0.0, height), speed=hover_speed(), **more)
    v.begin()
    return v


WHOLE = hovering({}).plant.rotor_thrust.copy()


@pytest.mark.parametrize("fraction", [-0.3, -0.1, 0.2])
def test_thrust_coefficient_error_scales_all_thrusts_and_torques(fraction):
    v, nominal = hovering({"thrust_coefficient_error": {"fraction": fraction}}), hovering({})
    assert v.plant.rotor_thrust == pytest.approx((1.0 + fraction) * nominal.plant.rotor_thrust)
    assert v.plant.rotor_torque == pytest.approx((1.0 + fraction) * nominal.plant.rotor_torque)
    assert not np.abs(v.plant.moment).max() > 1e-12


@pytest.mark.parametrize("i, name", enumerate(ROTOR_NAMES))
def test_weak_propeller_is_the_named_one(i, name):
    v = hovering({"weak_propeller": {name: 0.25}})
    share = v.plant.rotor_thrust / WHOLE
    expected = np.ones(4)
    expected[i] = 0.75
    assert share == pytest.approx(expected)
    hub = v.params.rotor_positions()[i]
    lost = 0.25 * WHOLE[i]
    assert v.wrench[3:5] == pytest.approx([-hub[1] * lost, hub[0] * lost])
    assert np.sign(v.plant.moment[2]) == SPIN[i]  # the drag that it lacks held the body back


def test_scatter_is_one_draw_for_each_rotor_and_flight():
    draws = np.array([1.0, -0.5, 0.0, 2.0, 9.0, 9.0, 9.0, 9.0])
    v = Vehicle({"thrust_scatter": {"deviation": 0.1}}, draws=draws, speed=hover_speed())
    shares = v.fly(0.05, watch=lambda v: v.plant.efficiency.copy())
    assert shares == pytest.approx(np.tile([1.1, 0.95, 1.0, 1.2], (50, 1)))


# --- inertia --------------------------------------------------------------------------------


@pytest.mark.parametrize("axis, name", enumerate(("xx", "yy", "zz")))
def test_inertia_error_slows_the_turn_about_its_own_axis_and_no_other(axis, name):
    turns = []
    for effects in ({}, {"inertia_error": {name: 0.25}}):
        v = Vehicle(effects)
        v.plant.rotor_command = np.array([520.0, 470.0, 480.0, 530.0]) + 60.0 * SPIN
        v.plant.rotor_speed = v.plant.rotor_command
        v.begin()
        v.finish()
        turns.append(v.rates.copy())
    expected = np.ones(3)
    expected[axis] = 1.0 / 1.25
    assert turns[1] / turns[0] == pytest.approx(expected, rel=3e-3)
    assert v.mass == v.params.mass


# --- ground effect --------------------------------------------------------------------------


def gain(height, strength=1.0):
    """Return thrust over thrust far from the floor, with the disc at `height`."""
    v = hovering({"ground_effect": {"strength": strength}}, height=height - 0.03)
    return v.plant.rotor_thrust[0] / WHOLE[0]


def test_thrust_near_the_floor_is_that_of_cheeseman_and_bennett(vehicle):
    radius = vehicle.rotor_radius
    assert gain(radius) == pytest.approx(16.0 / 15.0)
    assert gain(2.0 * radius) == pytest.approx(64.0 / 63.0)


# --- airframe -------------------------------------------------------------------------------


@pytest.mark.parametrize("fraction", [-0.2, 0.1, 0.5])
def test_mass_error_changes_acceleration_but_not_free_fall(no_air, vehicle, fraction):
    heavy = {"mass_error": {"fraction": fraction}}
    v, nominal = hovering(heavy), hovering({})
    assert v.mass == pytest.approx(vehicle.mass * (1.0 + fraction))
    assert (v.inertia == nominal.inertia).all()
    specific = [x.plant.force[2] / x.mass for x in (v, nominal)]
    assert specific[0] * (1.0 + fraction) == pytest.approx(specific[1])
    falling = Vehicle(heavy, maps=no_air)
    falling.fly(0.5)
    assert falling.velocity[2] == pytest.approx(-9.80665 * 0.5)


@pytest.mark.parametrize(
    "offset, axis, sign",
    [({"x": 0.02}, 1, +1.0), ({"x": -0.02}, 1, -1.0), ({"y": 0.02}, 0, -1.0)],
    ids=["nose heavy", "tail heavy", "left heavy"],
)
def test_the_heavy_side_goes_down(vehicle, offset, axis, sign):
    """FLU: positive pitch is nose down, negative roll is left side down."""
    v = hovering({"cog_offset": offset})
    lever = abs(next(iter(offset.values())))
    assert v.wrench[3 + axis] == pytest.approx(sign * lever * WHOLE.sum())
    v.finish()
    v.fly(0.1)
    assert sign * v.rotation.as_rotvec()[axis] > 0.0

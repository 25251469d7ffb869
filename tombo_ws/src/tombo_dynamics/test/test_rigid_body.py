"""Newton-Euler equations: conserved quantities, and the equations of motion."""

import math

import numpy as np
import pytest
from one_vehicle import Vehicle, hover_speed, random_attitude
from scipy.spatial.transform import Rotation

from tombo_dynamics.vehicle import GRAVITY, SPIN, VehicleParams

UNLIKE = VehicleParams(inertia_xx=0.010, inertia_yy=0.0135, inertia_zz=0.020)
"""Three different moments of inertia."""


def tumbling(seed, **more):
    rng = np.random.default_rng(seed)
    return Vehicle(
        attitude=random_attitude(rng), rates=rng.normal(0.0, 6.0, 3),
        velocity=rng.normal(0.0, 2.0, 3), **more,
    )  # fmt: skip


# --- translation ----------------------------------------------------------------------------


def test_a_thrown_vehicle_flies_a_parabola(no_air):
    v = Vehicle(maps=no_air, position=(1.0, 2.0, 50.0), velocity=(3.0, -1.0, 4.0))
    v.fly(1.5)
    drop = 0.5 * GRAVITY * 1.5**2
    assert v.position == pytest.approx([1.0 + 4.5, 2.0 - 1.5, 50.0 + 6.0 - drop], abs=1e-10)
    assert v.velocity == pytest.approx([3.0, -1.0, 4.0 - GRAVITY * 1.5], abs=1e-11)


def test_thrust_acts_along_body_z():
    lean = Rotation.from_euler("zyx", [0.4, 0.3, -0.2])
    v = Vehicle(attitude=lean.as_quat(), speed=600.0)
    v.begin()
    force = v.plant.rotor_thrust.sum() * lean.apply([0.0, 0.0, 1.0])
    v.finish()
    expected = (force / v.mass - [0.0, 0.0, GRAVITY]) * 1e-3
    assert v.velocity == pytest.approx(expected, rel=1e-3, abs=1e-9)


def test_hover_is_an_equilibrium(vehicle):
    v = Vehicle(speed=hover_speed())
    v.fly(1.0)
    assert v.velocity[2] == pytest.approx(0.0, abs=1e-3)  # as exact as the table's inverse
    assert np.delete(v.velocity, 2) == pytest.approx(np.zeros(2), abs=1e-12)
    assert v.rates == pytest.approx(np.zeros(3), abs=1e-12)


# --- rotation -------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_free_rotation_keeps_angular_momentum_and_energy(no_air, seed):
    v = tumbling(seed, maps=no_air, params=UNLIKE)
    momentum, energy = v.angular_momentum(), v.rotation_energy()
    rates = v.rates.copy()
    v.fly(1.0)
    assert v.angular_momentum() == pytest.approx(momentum, abs=1e-10)
    assert v.rotation_energy() == pytest.approx(energy, rel=1e-9)
    assert np.abs(v.rates - rates).max() > 0.5  # it did nutate


# --- the rotors' gyroscopic torque ----------------------------------------------------------


@pytest.mark.parametrize("rates", [(0.0, 0.0, 0.0), (3.0, -2.0, 1.0)])
def test_spinning_rotors_up_turns_the_body_the_other_way(no_air, rates):
    """Without drag torque nothing leaves: body and rotors together keep their momentum."""
    v = Vehicle(maps=no_air, params=UNLIKE, rates=rates, speed=300.0)
    momentum = v.angular_momentum()
    yaw_rate = v.rates[2]

    def command(k):
        return [800.0, 700.0, 100.0, 50.0] if k < 200 else [100.0, 50.0, 600.0, 800.0]

    v.fly(0.2, command)
    assert v.rates[2] < yaw_rate - 1.0  # counter-clockwise ones up: the body turns clockwise
    assert v.angular_momentum() == pytest.approx(momentum, abs=1e-9)
    v.fly(0.4, lambda k: command(k + 200))
    assert v.angular_momentum() == pytest.approx(momentum, abs=1e-9)


def test_a_spinning_rotor_makes_roll_precess_into_pitch(no_air):
    """Transverse rates turn in the body at H / I: the free precession of a gyroscope."""
    v = Vehicle(maps=no_air, rates=(0.3, 0.0, 0.0), speed=[800.0, 800.0, 0.0, 0.0])
    pace = v.rotor_momentum() / v.params.inertia_xx
    t = 0.15
    v.fly(t)
    # yaw stays 0, so the body adds nothing of its own
    assert v.rates == pytest.approx(
        [0.3 * math.cos(pace * t), 0.3 * math.sin(pace * t), 0.0], abs=1e-9
    )


# --- moments of the rotors ------------------------------------------------------------------


@pytest.mark.parametrize(
    "stronger, axis, sign",
    [
        ((1, 2), 0, +1.0),  # left side lifts: rolls right, positive about x (forward)
        ((0, 3), 0, -1.0),
        ((1, 3), 1, +1.0),  # rear lifts: nose down, positive about y (left)
        ((0, 2), 1, -1.0),
        ((2, 3), 2, +1.0),  # clockwise rotors drag the body counter-clockwise
        ((0, 1), 2, -1.0),
    ],
)
def test_two_stronger_rotors_turn_the_body(stronger, axis, sign):
    speed = np.full(4, 450.0)
    speed[list(stronger)] = 500.0
    v = Vehicle(speed=speed)
    v.fly(0.05)
    others = np.delete(v.rates, axis)
    assert sign * v.rates[axis] > 0.01
    assert np.abs(others).max() < 0.01 * abs(v.rates[axis])


def test_roll_moment_is_thrust_times_arm(vehicle):
    speed = np.full(4, 450.0)
    speed[[1, 2]] = 500.0
    v = Vehicle(speed=speed)
    v.begin()
    arm = vehicle.arm_length / math.sqrt(2.0)
    excess = v.plant.rotor_thrust[[1, 2]].sum() - v.plant.rotor_thrust[[0, 3]].sum()
    assert v.plant.moment[0] == pytest.approx(arm * excess)
    assert v.plant.moment[2] == pytest.approx(-SPIN @ v.plant.rotor_torque, abs=1e-15)
    assert v.plant.force[2] == pytest.approx(v.plant.rotor_thrust.sum())


# --- rotor speed ----------------------------------------------------------------------------


@pytest.mark.parametrize("tick", [0.5e-3, 1e-3, 5e-3])
def test_rotor_speed_follows_a_step_with_its_time_constant(vehicle, tick):
    v = Vehicle(speed=300.0, tick=tick)
    v.fly(vehicle.motor_time_constant, lambda k: np.full(4, 600.0))
    reached = 600.0 - 300.0 * math.exp(-1.0)
    assert v.plant.rotor_speed == pytest.approx(np.full(4, reached), rel=1e-12)
    assert (v.plant.rotor_speed[0] - 300.0) / 300.0 == pytest.approx(0.632, abs=1e-3)


# --- integration ----------------------------------------------------------------------------

SMOOTH = {"linear_rotor_drag": {"d_xy": 0.5, "d_z": 0.3}, "quadratic_body_drag": {"c_area": 0.05},
          "steady_wind": {"east": 3.0, "north": -2.0}}  # fmt: skip


def test_halving_the_tick_divides_the_error_by_sixteen():
    """Rotor speeds stay within one piece of the map, so that all is smooth."""

    def end(tick):
        v = tumbling(7, effects=SMOOTH, params=UNLIKE, tick=tick, speed=466.0)
        v.fly(0.32, lambda k: [484.0, 466.0, 470.0, 480.0])
        return v.body.copy()

    exact = end(0.5e-3)
    errors = [np.abs(end(tick) - exact).max() for tick in (16e-3, 8e-3, 4e-3)]
    assert errors[0] > 1e-7
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.2)

"""Wind, gusts and drag: forces against the motion through the air."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_vehicle import NOISE, QUIET, UPRIGHT, Vehicle, hover_speed, random_attitude
from scipy.spatial.transform import Rotation

from tombo_dynamics.vehicle import GRAVITY, VehicleParams

AIR_DENSITY = 1.2041
DRAG = {"linear_rotor_drag": {"d_xy": 0.5, "d_z": 0.3}, "quadratic_body_drag": {"c_area": 0.05}}
HIGH = (0.0, 0.0, 2000.0)


@given(st.integers(0, 10_000))
def test_only_the_motion_through_the_air_counts(seed):
    """Galilei: moving with the wind is standing still in calm air."""
    rng = np.random.default_rng(seed)
    attitude, rates, velocity = random_attitude(rng), rng.normal(size=3), rng.normal(0, 3, 3)
    wind = np.append(rng.normal(0.0, 3.0, 2), 0.0)
    calm = Vehicle(DRAG, attitude=attitude, rates=rates, velocity=velocity, speed=400.0)
    windy = Vehicle(
        DRAG | {"steady_wind": {"east": wind[0], "north": wind[1]}},
        attitude=attitude, rates=rates, velocity=velocity + wind, speed=400.0,
    )  # fmt: skip
    calm.fly(0.1)
    windy.fly(0.1)
    assert windy.velocity - wind == pytest.approx(calm.velocity, abs=1e-9)
    assert windy.body[6:] == pytest.approx(calm.body[6:], abs=1e-9)


@given(st.integers(0, 10_000))
def test_drag_takes_energy_from_every_motion(seed):
    rng = np.random.default_rng(seed)
    v = Vehicle(DRAG, attitude=random_attitude(rng), velocity=rng.normal(0.0, 5.0, 3))
    v.begin()
    power = v.plant.force @ v.rotation.inv().apply(v.velocity)
    assert power < 0.0
    assert not v.plant.moment.any()  # at the centre of mass


ON_EDGE = Rotation.from_euler("y", 0.5 * math.pi).as_quat()
WEIGHT = VehicleParams().mass * GRAVITY


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drag", "attitude", "speed"),
    [
        ({"linear_rotor_drag": {"d_xy": 2.0, "d_z": 1.5}}, UPRIGHT, WEIGHT / 1.5),
        ({"linear_rotor_drag": {"d_xy": 2.0, "d_z": 1.5}}, ON_EDGE, WEIGHT / 2.0),
        ({"quadratic_body_drag": {"c_area": 0.2}}, UPRIGHT,
         math.sqrt(2.0 * WEIGHT / (AIR_DENSITY * 0.2))),
    ],
)  # fmt: skip
def test_terminal_speed(no_air, drag, attitude, speed):
    v = Vehicle(drag, maps=no_air, position=HIGH, attitude=attitude)
    v.fly(20.0)
    assert v.velocity[2] == pytest.approx(-speed, rel=1e-4)


def flapping(velocity, **more):
    """Return the moment of flapping, k = 0.02 N m s/m, in body axes."""
    moments = []
    for effects in ({"flapping_moment": {"k": 0.02}}, {}):
        v = Vehicle(effects, velocity=velocity, speed=hover_speed(), **more)
        v.begin()
        moments.append(v.wrench.copy())
    change = moments[0] - moments[1]
    assert not change[:3].any()
    return change[3:]


@given(st.integers(0, 10_000))
def test_flapping_is_the_moment_of_a_drag_above_the_centre_of_mass(seed):
    rng = np.random.default_rng(seed)
    attitude, velocity = random_attitude(rng), rng.normal(0.0, 3.0, 3)
    flow = Rotation.from_quat(attitude).inv().apply(velocity)
    above, drag = [0.0, 0.0, 0.1], -0.2 * flow  # 0.1 m times 0.2 N s/m
    assert flapping(velocity, attitude=attitude) == pytest.approx(np.cross(above, drag), abs=1e-12)


@pytest.mark.parametrize("k", [-0.02, 0.03])
def test_translational_lift_grows_with_squared_in_plane_airspeed(k):
    lift = {"translational_lift": {"k": k}, "steady_wind": {"east": 1.0}}
    tilt = Rotation.from_euler("y", 0.3)
    v = Vehicle(lift, velocity=(4.0, 2.0, -1.0), attitude=tilt.as_quat(), speed=hover_speed())
    v.begin()
    u, w, _ = tilt.inv().apply([3.0, 2.0, -1.0])
    assert v.plant.efficiency == pytest.approx(np.full(4, 1.0 + k * (u * u + w * w)))
    still = Vehicle(lift, velocity=(1.0, 0.0, -3.0), speed=hover_speed())
    still.begin()
    assert still.plant.efficiency == pytest.approx(np.ones(4))


# --- gusts ----------------------------------------------------------------------------------


def gusts(deviation, time, seconds=60.0, seed=0):
    v = Vehicle({"gusts": {"deviation": deviation, "time": time}}, position=HIGH)
    noise = np.random.default_rng(seed).standard_normal((round(seconds * 1e3), NOISE))
    seen = []
    for row in noise:
        v.plant.state.position[2] = 2000.0
        v.begin(row)
        seen.append(v.plant.wind.copy())
        v.plant.ticks += 1
    return np.array(seen)


@pytest.mark.slow
def test_gusts_have_the_deviation_asked_for_on_each_axis():
    wind = gusts(0.7, 0.05)  # 60 s are 600 independent samples
    assert wind.std(axis=0) == pytest.approx(np.full(3, 0.7), rel=0.1)
    assert np.abs(wind.mean(axis=0)).max() < 0.1
    between = np.corrcoef(wind.T)[np.triu_indices(3, 1)]
    assert np.abs(between).max() < 0.15


def test_wind_swings_about_its_mean():
    wind = {"east": 3.0, "swing_north": 2.0, "frequency": 5.0, "phase": 0.3}
    v = Vehicle({"steady_wind": wind})
    for k in range(60):
        v.begin(QUIET)
        swing = 2.0 * math.sin(2.0 * math.pi * 5.0 * 0.001 * k + 0.3)
        assert v.plant.wind == pytest.approx([3.0, swing, 0.0])
        v.finish(QUIET)

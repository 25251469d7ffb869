"""Symmetries of space that the whole plant obeys: mirrored, turned and moved worlds."""

import math

import numpy as np
import pytest
from one_vehicle import Vehicle
from scipy.spatial.transform import Rotation

EVERYTHING = {
    "linear_rotor_drag": {"d_xy": 0.4, "d_z": 0.2},
    "quadratic_body_drag": {"c_area": 0.05},
    "ground_effect": {"strength": 1.0},
    "contact_force": {"stiffness": 6000.0, "damping": 25.0},
    "blade_strike": {"peak_force": 145.5, "recovery_time": 0.42, "slant": 0.4, "duration": 0.014},
    "propeller_wear": {"collisions": 3.0},
    "battery_sag": {"resistance": 0.03, "discharge": 0.5},
    "command_delay": {"delay": 0.0105},
}
LEFT_RIGHT, FRONT_REAR = (1, [2, 3, 0, 1]), (0, [3, 2, 1, 0])
"""Axis that changes sign, and the rotor that comes to stand where another one stood."""


def command(k):
    phases = np.array([0.0, 1.0, 2.0, 4.0])
    return 500.0 + 60.0 * np.sin(0.05 * k + phases)


def scene(seed):
    """Return a vehicle that flies into a pole, scrapes along it and falls to the ground."""
    rng = np.random.default_rng(seed)
    lean = Rotation.from_euler("ZYX", [rng.uniform(-3.0, 3.0), *rng.normal(0.0, 0.1, 2)])
    flight = rng.normal((1.2, 0.0, 0.0), 0.2)
    sight = rng.uniform(-3.0, 3.0)
    return {
        "position": np.array([0.3, -0.2, 0.9]),
        "velocity": Rotation.from_euler("z", sight).apply(flight),
        "attitude": lean.as_quat(),
        "rates": rng.normal(0.0, 0.3, 3),
        "obstacle": np.array([0.3 + 0.65 * np.cos(sight), -0.2 + 0.65 * np.sin(sight), 0.2, 2.0]),
        "wind": np.array([2.0, 1.0]),
    }


def fly(scene, seconds=1.2, order=(0, 1, 2, 3)):
    wind = {"steady_wind": {"east": scene["wind"][0], "north": scene["wind"][1]}}
    where = {k: value for k, value in scene.items() if k != "wind"}
    v = Vehicle(EVERYTHING | wind, speed=command(0)[list(order)], **where)
    touched = v.fly(
        seconds, lambda k: command(k)[list(order)], watch=lambda v: v.plant.contact.touching
    )
    return v, touched.any()


@pytest.mark.parametrize("axis, order", [LEFT_RIGHT, FRONT_REAR], ids=["left-right", "front-rear"])
@pytest.mark.parametrize("seed", range(3))
def test_a_mirrored_world_moves_as_the_mirror_image(axis, order, seed):
    flip = np.ones(3)
    flip[axis] = -1.0
    turn = -flip  # axial vectors: rates, and the vector part of the quaternion
    world = scene(seed)
    image = {
        "position": flip * world["position"],
        "velocity": flip * world["velocity"],
        "attitude": np.append(turn, 1.0) * world["attitude"],
        "rates": turn * world["rates"],
        "obstacle": np.append(flip[:2], [1.0, 1.0]) * world["obstacle"],
        "wind": flip[:2] * world["wind"],
    }
    there, touched = fly(world)
    mirrored, _ = fly(image, order=order)
    assert touched
    assert mirrored.position == pytest.approx(flip * there.position, abs=1e-6)
    assert mirrored.velocity == pytest.approx(flip * there.velocity, abs=1e-5)
    assert mirrored.rates == pytest.approx(turn * there.rates, abs=1e-5)
    assert mirrored.plant.fold == pytest.approx(there.plant.fold[order], abs=1e-6)
    assert mirrored.plant.rotor_speed == pytest.approx(there.plant.rotor_speed[order], abs=1e-5)
    assert mirrored.plant.damage == pytest.approx(there.plant.damage[order], abs=1e-6)


@pytest.mark.parametrize("angle", [0.3, math.pi / 2, -2.5])
@pytest.mark.parametrize("seed", range(2))
def test_a_turned_world_moves_alike(angle, seed):
    turn = Rotation.from_euler("z", angle)
    world = scene(seed)
    turned = dict(world)
    for name in ("position", "velocity"):
        turned[name] = turn.apply(world[name])
    turned["attitude"] = (turn * Rotation.from_quat(world["attitude"])).as_quat()
    turned["wind"] = turn.apply([*world["wind"], 0.0])[:2]
    turned["obstacle"] = np.append(turn.apply([*world["obstacle"][:2], 0.0])[:2], [0.2, 2.0])
    here, touched = fly(world)
    there, _ = fly(turned)
    assert touched
    assert there.position == pytest.approx(turn.apply(here.position), abs=1e-6)
    assert there.velocity == pytest.approx(turn.apply(here.velocity), abs=1e-5)
    assert there.rates == pytest.approx(here.rates, abs=1e-5)
    assert (there.rotation * here.rotation.inv() * turn.inv()).magnitude() < 1e-6

"""A load on a thread: its weight, its period, its momentum, and the floor."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_vehicle import Vehicle, random_attitude, vacuum_maps

from tombo_dynamics.vehicle import GRAVITY


def loaded(mass, length, x=0.0, y=0.0, **where):
    return Vehicle({"hanging_load": {"mass": mass, "length": length, "x": x, "y": y}}, **where)


def load_of(v):
    return v.plant.memories.hanging_load


def test_load_pulls_with_its_weight_at_its_tie():
    """In a hover that carries both, held in place."""
    load, tied = 0.2, (0.1, -0.05)
    v = loaded(load, 0.5, *tied)
    for _ in range(1000):
        v.body = [0.0, 0.0, 10.0, *[0.0] * 6, 1.0, 0.0, 0.0, 0.0]
        v.begin()
        v.finish()
    assert load * load_of(v).pull == pytest.approx([0.0, 0.0, -load * GRAVITY], rel=0.01, abs=1e-9)
    weight = load * GRAVITY
    expected = [0.0, 0.0, -weight, -tied[1] * weight, tied[0] * weight, 0.0]
    empty = Vehicle()
    empty.begin()
    assert v.wrench - empty.wrench == pytest.approx(expected, rel=0.01, abs=1e-4)


def test_load_swings_with_the_period_of_a_pendulum(no_air):
    """Below a vehicle that is held in place."""
    length = 1.0
    v = loaded(0.1, length, maps=no_air, position=(0.0, 0.0, 50.0))
    v.begin()
    load_of(v).position = [length * math.sin(0.1), 0.0, 50.0 - length * math.cos(0.1)]
    sideways = []
    for _ in range(6000):
        v.body = [0.0, 0.0, 50.0, *[0.0] * 6, 1.0, 0.0, 0.0, 0.0]
        v.begin()
        sideways.append(load_of(v).position[0])
        v.finish()
    x = np.array(sideways)
    up = np.flatnonzero((x[1:] >= 0.0) & (x[:-1] < 0.0)) * 1e-3
    period = 2.0 * math.pi * math.sqrt(length / GRAVITY) * (1.0 + 0.1**2 / 16.0)
    assert np.diff(up) == pytest.approx(period, rel=0.005)
    assert np.abs(x[-2100:]).max() > 0.08  # the thread takes little of the swing


@pytest.mark.slow
@given(st.integers(0, 1000))
def test_vehicle_and_load_keep_their_momentum(seed):
    rng = np.random.default_rng(seed)
    v = loaded(
        0.4, 0.6, 0.05, 0.02, maps=vacuum_maps(), position=(0.0, 0.0, 100.0),
        velocity=rng.normal(0.0, 1.0, 3), attitude=random_attitude(rng), rates=rng.normal(0, 1, 3),
    )  # fmt: skip
    v.fly(0.05)
    load = load_of(v)

    def momentum():
        return v.mass * v.velocity + 0.4 * load.velocity

    before = momentum()
    v.fly(0.5)
    fallen = np.array([0.0, 0.0, -(v.mass + 0.4) * GRAVITY * 0.5])
    # a pull that stays in map for a tick turns a little in the body: second order in the tick
    assert momentum() == pytest.approx(before + fallen, abs=2e-3)


def test_load_lies_on_the_floor_until_the_thread_is_taut():
    v = loaded(0.2, 0.7, position=(0.0, 0.0, 0.18))
    for height in (0.3, 0.69):
        v.plant.state.position[2] = height
        v.plant.state.velocity = 0.0
        v.begin()
        load = load_of(v)
        assert load.position[2] == 0.0 and not load.pull.any()
        v.finish()
    v.plant.state.position[2] = 0.72
    v.begin()
    assert load_of(v).pull[2] < 0.0


def test_unbalance_force_has_the_square_of_the_speed_and_rotates():
    size, speed = 5e-6, 400.0
    v = Vehicle({"propeller_unbalance": {"rear_left": size}}, maps=vacuum_maps(), speed=speed)
    pulls = []
    for _ in range(1000):
        v.begin()
        pulls.append(v.wrench.copy())
        v.plant.state.rates = 0.0
        v.finish()
        v.plant.state.rates = 0.0
    force = np.array(pulls)[:, :2]
    assert np.hypot(*force.T) == pytest.approx(size * speed**2, rel=0.01)
    turned = np.unwrap(np.arctan2(force[:, 1], force[:, 0]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(speed * 0.999, rel=1e-3)
    assert np.abs(force.mean(axis=0)).max() < 0.02 * size * speed**2

"""Reactions that guide: their ways from the contact to x_r."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_collision.decision import Estimate
from tombo_collision.reactions import REGISTRY
from tombo_collision.reactions.admittance import Admittance
from tombo_collision.reactions.mpc import Mpc, best_acceleration
from tombo_collision.reactions.reflex import Reflex
from tombo_dynamics.messages import CollisionEvent

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
X_C = np.array([1.7, 0.0, 2.0])
EVENT = CollisionEvent(
    23_100_000_000,
    "map",
    3,
    23_096_000_000,
    X_C,
    np.array([1.0, 0.0, 0.0]),
    1.0,
    100.0,
    1,
    2,
    np.array([-0.8, -0.6, 0.0]),
)
GUIDED = sorted(name for name, kind in REGISTRY.items() if "imu" in kind.needs)


def moving(position=X_C, velocity=(-0.1, 0.0, 0.0), rates=(0.0, 0.0, 5.0)):
    return Estimate(np.array(position), np.array(velocity, float), LEVEL, np.array(rates, float))


@pytest.mark.parametrize("name", GUIDED)
def test_n_r_is_the_push_and_without_one_against_the_flight(name):
    reaction = REGISTRY[name]()
    decision = reaction.begin(EVENT, moving(), None)
    assert decision.n_r == pytest.approx(EVENT.push)
    assert decision.x_r == pytest.approx(X_C + 0.8 * EVENT.push)
    unknown = replace(EVENT, push=np.zeros(3))
    assert reaction.begin(unknown, moving(), None).n_r == pytest.approx([-1.0, 0.0, 0.0])


@pytest.mark.parametrize("name", GUIDED)
def test_it_is_over_at_rest_at_x_r_or_when_time_is_up(name):
    reaction = REGISTRY[name]()
    decision = reaction.begin(EVENT, moving(), None)
    assert not decision.over(0.1, moving())
    assert decision.over(reaction.timeout + 0.1, moving())
    assert decision.over(1.0, moving(decision.x_r, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert not decision.over(1.0, moving(decision.x_r, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0)))


@pytest.mark.parametrize("name", GUIDED)
def test_yaw_follows_the_vehicle_until_it_turns_no_more(name):
    decision = REGISTRY[name]().begin(EVENT, moving(), None)
    turned = replace(moving(), attitude=np.array([0.0, 0.0, math.sin(0.4), math.cos(0.4)]))
    assert decision.reference(0.1, turned).yaw == pytest.approx(0.8)
    calm = replace(moving(rates=(0.0, 0.0, 0.1)), attitude=LEVEL)
    assert decision.reference(0.2, calm).yaw == pytest.approx(0.8)


@pytest.mark.parametrize("damping", [1.0, 5.2, 20.0])
def test_admittance_moves_as_mass_spring_and_damper(damping):
    reaction = Admittance(damping=damping)
    start = moving(velocity=(-0.3, 0.2, -0.1))
    decision = reaction.begin(EVENT, start, None)
    first = decision.reference(0.0, start)
    assert first.position == pytest.approx(X_C) and first.velocity == pytest.approx(start.velocity)
    x, v, step = X_C.copy(), start.velocity.copy(), 1e-4
    for _ in range(10_000):  # semi-implicit Euler, a second
        force = -reaction.stiffness * (x - decision.x_r) - damping * v
        v = v + step * force / reaction.mass
        x = x + step * v
    flown = decision.reference(1.0, start)
    assert flown.position == pytest.approx(x, abs=1e-3)
    assert flown.velocity == pytest.approx(v, abs=2e-3)
    assert flown.acceleration == pytest.approx(
        (-reaction.stiffness * (x - decision.x_r) - damping * v) / reaction.mass, abs=1e-2
    )


@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array),
)
def test_mpc_asks_for_no_more_than_tilt_and_thrust_allow(offset, velocity):
    params = Mpc()
    a = best_acceleration(params, offset, velocity, np.zeros(3))
    lift = a[2] + 9.80665
    assert math.hypot(a[0], a[1]) <= math.tan(params.tilt_max) * lift + 1e-6
    assert math.hypot(a[0], a[1], lift) <= params.thrust_max * 9.80665 + 1e-6


def test_mpc_takes_a_point_mass_to_rest_at_the_goal():
    params, x, v, a = Mpc(), np.array([0.8, -0.2, 0.1]), np.array([0.3, 0.0, -0.2]), np.zeros(3)
    for _ in range(150):
        a = best_acceleration(params, x, v, a)
        x, v = x + 0.02 * v + 0.0002 * a, v + 0.02 * a
    assert np.linalg.norm(x) < 0.02 and np.linalg.norm(v) < 0.05


def test_reflex_mixes_push_and_flight_by_its_share():
    n_r = Reflex(push_share=0.5).begin(EVENT, moving(), None).n_r
    mixed = 0.5 * EVENT.push + 0.5 * np.array([-1.0, 0.0, 0.0])
    assert n_r == pytest.approx(mixed / np.linalg.norm(mixed))

"""Reactions by name; the paper's: x_r = x_c + d_r n_r, second collisions, the floor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_collision.decision import Estimate, against_flight
from tombo_collision.reactions import REGISTRY, reaction_from_mapping
from tombo_collision.reactions.bounce import Bounce
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import validate

P = Bounce()
coordinate = st.floats(-20.0, 20.0)
places = st.tuples(coordinate, coordinate, st.floats(2.0, 20.0)).map(np.array)
units = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)


STILL = Estimate(
    np.array([1.7, 0.0, 2.0]), np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
)


def event(x_c, direction):
    x_c, direction = np.array(x_c, float), np.array(direction, float)
    return CollisionEvent(23_100_000_000, "map", 2, 23_080_000_000, x_c, direction, 1.0, 100.0, 1)


def decide(last, collision, params):
    return params.begin(collision, STILL, last)


@given(places, units, st.floats(0.05, 1.2))
def test_x_r_lies_at_d_r_from_x_c_against_the_flight(x_c, direction, distance):
    state = decide(None, event(x_c, direction), Bounce(distance=distance))
    assert np.array_equal(state.x_r, x_c + distance * state.n_r)
    assert np.linalg.norm(state.n_r) == pytest.approx(1.0)
    assert state.n_r @ direction < 0.0


@given(units)
def test_n_r_is_horizontal_unless_the_flight_was_nearly_vertical(direction):
    n_r = against_flight(direction)
    across = np.hypot(direction[0], direction[1])
    if across > 0.21:
        assert n_r[2] == 0.0
        assert np.allclose(n_r[:2], -direction[:2] / across)
    elif across < 0.19:
        assert np.array_equal(n_r, -direction)


@given(st.floats(-1.0, 0.69), units)
def test_x_r_is_not_put_below_the_floor(height, direction):
    state = decide(None, event([1.0, 2.0, height], direction), P)
    assert state.x_r[2] == max(height + P.distance * state.n_r[2], P.height_min)
    assert state.x_r[:2] == pytest.approx((state.x_c + P.distance * state.n_r)[:2])


FIRST = decide(None, event([1.7, 0.0, 2.0], [1.0, 0.0, 0.0]), P)


@pytest.mark.parametrize("gap", [0.5, 0.8, 1.1])
def test_between_two_obstacles_it_leaves_sideways(gap):
    """On the way back it hits another one: straight away from that is into the first."""
    x_c = np.array([1.7 - gap, 0.0, 2.0])
    state = decide(FIRST, event(x_c, [-1.0, 0.0, 0.0]), P)
    assert np.linalg.norm(state.x_r - x_c) == pytest.approx(P.distance)
    assert abs(state.n_r[0]) < 1e-9
    assert np.linalg.norm(state.x_r - FIRST.x_c) >= 0.5 * P.distance


def test_in_a_corner_it_leaves_between_the_two_walls():
    """First a wall ahead, then one to the left, hit while close to the first."""
    x_c = np.array([1.5, 0.7, 2.0])
    state = decide(FIRST, event(x_c, [0.0, 1.0, 0.0]), P)
    assert state.n_r == pytest.approx(np.array([-1.0, -1.0, 0.0]) / np.sqrt(2.0))
    assert np.linalg.norm(state.x_r - FIRST.x_c) > 0.5 * P.distance


def test_every_registered_reaction_has_a_name_and_bounded_parameters():
    assert {"bounce", "none"} <= set(REGISTRY)
    for name, kind in REGISTRY.items():
        assert kind.name == name
        validate(kind(), name)
        decision = kind().begin(event([1.7, 0.0, 2.0], [1.0, 0.0, 0.0]), STILL, None)
        assert decision is None or np.isfinite(decision.x_r).all()


def test_a_reaction_is_chosen_by_name_and_refuses_what_it_does_not_know():
    assert reaction_from_mapping({"name": "bounce", "distance": 0.5}) == Bounce(distance=0.5)
    assert reaction_from_mapping({"name": "none"}).name == "none"
    for wrong in ({"name": "bouncy"}, {"distance": 1e9}, {"name": "none", "distance": 0.5}):
        with pytest.raises(InputError):
            reaction_from_mapping(wrong)

"""Vectors: what each function gives, of tuples, arrays and fields of records alike."""

import numpy as np
import pytest

from tombo_dynamics import vectors
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import State

A, B = (1.0, -2.0, 4.0), (0.5, 3.0, -1.0)
RESULTS = {
    vectors.add: np.add(A, B),
    vectors.subtract: np.subtract(A, B),
    vectors.multiply: np.multiply(A, B),
    vectors.cross: np.cross(A, B),
    vectors.dot: np.dot(A, B),
}


@pytest.mark.parametrize(("function", "expected"), RESULTS.items())
@pytest.mark.parametrize("kind", [tuple, np.array])
def test_two_vectors(function, expected, kind):
    assert np.array_equal(function(kind(A), kind(B)), expected)


def test_one_vector():
    assert vectors.vector(np.array(A)) == A
    assert vectors.scale(2.0, A) == (2.0, -4.0, 8.0)
    assert vectors.add_scaled(A, 2.0, B) == (2.0, 4.0, 2.0)
    assert vectors.clamp(A, 1.5) == (1.0, -1.5, 1.5)
    assert vectors.norm((2.0, -3.0, 6.0)) == 7.0
    assert vectors.all_finite(A)
    assert not vectors.all_finite((0.0, np.nan, 0.0))
    row = np.zeros(4)
    vectors.store(row[1:], A)
    assert row.tolist() == [0.0, *A]


@compiled
def _fill(state: State, table) -> None:
    state.velocity = vectors.add(state.velocity, table[1])
    state.position = state.velocity
    state.attitude = table[0, 0], table[0, 1], 0.0, 1.0
    state.rates = table[1, 0:3]


def test_field_takes_vector_and_row():
    state = State.new()
    state.velocity = A
    _fill(state, np.array([B, A]))
    assert state.velocity.tolist() == [2.0, -4.0, 8.0]
    assert state.position.tolist() == [2.0, -4.0, 8.0]
    assert state.attitude.tolist() == [0.5, 3.0, 0.0, 1.0]
    assert state.rates.tolist() == list(A)


@compiled
def _too_short(state: State) -> None:
    state.attitude = vectors.add(state.velocity, state.rates)


@compiled
def _every_second(state: State, table) -> None:
    state.velocity = table[::2]


def test_field_refuses_other_length_or_layout():
    with pytest.raises(TypeError, match="cannot take 3 numbers"):
        _too_short(State.new())
    with pytest.raises(TypeError, match="cannot take array"):
        _every_second(State.new(), np.zeros(6))

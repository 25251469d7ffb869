"""Vectors: what each function gives, of tuples, arrays and fields of records alike."""

import numpy as np

from tombo_dynamics import vectors
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import State

A, B = (1.0, -2.0, 4.0), (0.5, 3.0, -1.0)


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

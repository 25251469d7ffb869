"""A small neural network of a policy: layers of plain numbers, from a JSON file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tombo_collision.steering import ACTIONS, HIGH
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.yaml_text import read_text

Row = tuple[float, ...]
Network = tuple[tuple[Row, ...], ...]
"""Layers, each of rows: a row has the weights of one output, its bias last. Between layers, and
after the last one, is tanh."""
_WIDEST, _DEEPEST, _LARGEST = 256, 8, 1e6
_ACCEPTED = (
    f"a JSON file of layers, or the layers themselves: lists of rows [weights..., bias], "
    f"{HIGH.size} inputs, {ACTIONS} outputs, up to {_DEEPEST} layers of {_WIDEST}"
)


def read_network(name: str, value: object) -> Network | None:
    """Return a checked network.

    Args:
        name: of the parameter.
        value: a file's path, the layers, or none: None or an empty text.

    Raises:
        InputError: the file can't be read, or is not a network of the policy's size.
    """
    if value is None or value == "":
        return None
    if isinstance(value, str):
        text = read_text(Path(value), f"{name}: '{value}'", "a policy's JSON")
        try:
            value = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{name}: no JSON; accepted: {_ACCEPTED}") from error
    if not isinstance(value, list | tuple) or not 1 <= len(value) <= _DEEPEST:
        raise InputError(f"{name}: {shown(value)} has no layers; accepted: {_ACCEPTED}")
    layers, inputs = [], HIGH.size
    for k, layer in enumerate(value):
        layers.append(_layer(f"{name}[{k}]", layer, inputs))
        inputs = len(layers[-1])
    if inputs != ACTIONS:
        raise InputError(f"{name}: the last layer has {inputs} outputs; accepted: {_ACCEPTED}")
    return tuple(layers)


def _layer(name: str, layer: Any, inputs: int) -> tuple[Row, ...]:
    try:
        matrix = np.array(layer, np.float64)
    except (TypeError, ValueError, OverflowError):  # rows of other lengths, or no numbers
        matrix = np.zeros(0)
    fits = matrix.ndim == 2 and matrix.shape[1] == inputs + 1 and 1 <= len(matrix) <= _WIDEST
    if not fits or not (np.abs(matrix) < _LARGEST).all():
        raise InputError(
            f"{name}: {shown(layer)} has no finite rows of {inputs + 1} numbers; accepted: "
            f"{_ACCEPTED}"
        )
    return tuple(map(tuple, matrix.tolist()))


def network_text(layers: Sequence[Array]) -> str:
    """Return the text of a policy file of weight matrices (outputs, inputs + 1), biases last."""
    return json.dumps([np.asarray(layer, np.float64).tolist() for layer in layers]) + "\n"


@cache
def _matrices(network: Network) -> tuple[Array, ...]:
    return tuple(np.array(layer) for layer in network)


def answer(network: Network | None, observation: Any) -> Array:
    """Return the action (6) in [-1, 1] to an observation (23); without a network zeros."""
    if network is None:
        return np.zeros(ACTIONS)
    values: Array = np.asarray(observation, np.float64)
    for matrix in _matrices(network):
        values = np.tanh(matrix[:, :-1] @ values + matrix[:, -1])
    return values

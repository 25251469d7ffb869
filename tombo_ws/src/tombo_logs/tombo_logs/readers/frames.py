"""Axes of a log's world and body, turned into map (ENU) and base_link (FLU).

Axes are written as ours in terms of the file's: `[y, x, -z]` says that our x is the file's y, our
y its x, and our z its -z.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError

WORLDS = {"ENU": ("x", "y", "z"), "NED": ("y", "x", "-z"), "NWU": ("-y", "x", "z")}
BODIES = {"FLU": ("x", "y", "z"), "FRD": ("x", "-y", "-z"), "RFU": ("y", "-x", "z")}
_LETTERS = "xyz"
_ZERO_NORM = 1e-6
"""A quaternion with a smaller norm is a placeholder, zero up to rounding."""


def axes_matrix(axes: Sequence[str], what: str) -> Array:
    """Return (3, 3) that turns vectors given in the file's axes into ours.

    Raises:
        InputError: not each of x, y and z once.
    """
    matrix = np.zeros((3, 3))
    names = [str(axis).strip().lower() for axis in axes]
    if sorted(name.lstrip("+-") for name in names) != list(_LETTERS):
        raise InputError(
            f"{what}: axes {list(axes)}; accepted: x, y and z once each, with - where turned "
            "round, as [y, x, -z]"
        )
    for row, name in enumerate(names):
        matrix[row, _LETTERS.index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    return matrix


def is_usable(quaternions: Array) -> NDArray[np.bool_]:
    """Return which of the quaternions (..., 4) can be normalised, (...): finite and not zero."""
    with np.errstate(invalid="ignore", over="ignore"):
        norm = np.linalg.norm(quaternions, axis=-1)
    return np.asarray(np.isfinite(norm) & (norm > _ZERO_NORM))


def turn_attitude(quaternions: Array, world: Array, body: Array, turn: Rotation) -> Array:
    """Turn attitudes of the file's axes into attitudes, map from base_link.

    Args:
        quaternions: (N, 4) xyzw, the file's world from its body; not finite: stays so.
        world: of `axes_matrix`.
        body: of `axes_matrix`.
        turn: base_link to the body as the motion capture has it.

    Norms stay: one that is not 1 says that the columns hold something else.
    """
    out = np.full(quaternions.shape, np.nan)
    usable = is_usable(quaternions)
    if usable.any():
        matrices = world @ Rotation.from_quat(quaternions[usable]).as_matrix() @ body.T
        norms = np.linalg.norm(quaternions[usable], axis=1, keepdims=True)
        out[usable] = (Rotation.from_matrix(matrices) * turn).as_quat() * norms
    return out

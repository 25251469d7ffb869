"""Track of a flight from the motion capture, with velocity by differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array, Times

_UNIT = 1e-2
"""How far from 1 the length of a rotation's quaternion may be."""


@dataclass(frozen=True)
class PoseTrack:
    """Poses of base_link in map, in order of capture."""

    stamps_ns: Times
    """(N,) rising."""
    position: Array
    """(N, 3) [m]."""
    attitude: Array
    """(N, 4) xyzw."""
    velocity: Array
    """(N, 3) in map [m/s], by central differences."""


def pose_track(stamps_ns: Times, position: Array, attitude: Array) -> PoseTrack | None:
    """Return the track of poses as recorded: in any order, some twice, some no numbers at all.

    Args:
        stamps_ns: (N,) of capture.
        position: (N, 3) in map [m].
        attitude: (N, 4) xyzw.

    Returns:
        None if fewer than two poses can be used.
    """
    with np.errstate(invalid="ignore"):
        unit = np.abs(np.linalg.norm(attitude, axis=1) - 1.0) < _UNIT
    good = np.flatnonzero(unit & np.isfinite(position).all(axis=1))
    stamps, first = np.unique(stamps_ns[good], return_index=True)
    rows = good[first]
    if rows.size < 2:
        return None
    seconds = (stamps - stamps[0]) * 1e-9
    velocity = np.gradient(position[rows], seconds, axis=0)
    return PoseTrack(stamps, position[rows], attitude[rows], np.asarray(velocity))

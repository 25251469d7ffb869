"""Turn poses of a tracked rigid body into poses of base_link in map. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.messages import Pose
from tombo_dynamics.rotation import conjugate, quaternion_multiply, rotate_vector
from tombo_dynamics.time_base import SECOND_NS
from tombo_mocap.params import MocapParams

_HALF = math.sqrt(0.5)
_UP = {"z_up": (0.0, 0.0, 0.0, 1.0), "y_up": (_HALF, 0.0, 0.0, _HALF)}
"""Upward axis of a system → rotation xyzw to map from its world."""
_NOSE = {
    "+x": (0.0, 0.0, 0.0, 1.0),
    "+y": (0.0, 0.0, _HALF, _HALF),
    "-x": (0.0, 0.0, 1.0, 0.0),
    "-y": (0.0, 0.0, -_HALF, _HALF),
}
"""Axis of the rigid body to the nose → rotation xyzw to the rigid body from base_link."""
_UNIT_TOLERANCE = 0.1
"""Largest difference of a quaternion's norm from 1: float32, rounded exports and worse."""


class TrackedBody(NamedTuple):
    """One rigid body of a frame, as the system gives it."""

    name: str
    stamp_ns: int
    """Stamp of arrival, or of the driver's message."""
    position: Array
    """(3,) [m], in the world of the system."""
    attitude: Array
    """(4,) quaternion xyzw, world of the system from rigid body."""


@dataclass
class PoseCounters:
    """How many poses of the body were passed on, and why others were not."""

    sent: int = 0
    not_finite: int = 0
    not_newer: int = 0


class TrackedPoses:
    """Chooses the vehicle's rigid body, and turns its poses into map and base_link."""

    def __init__(self, params: MocapParams) -> None:
        self.body = params.body
        self._delay_ns = round(params.delay * SECOND_NS)
        self._to_map = np.array(_UP[params.up])
        # The axes of a rigid body are those of the world in which it was defined: y up as well.
        self._to_body = quaternion_multiply(conjugate(self._to_map), np.array(_NOSE[params.nose]))
        self._last_ns = -1
        self.counters = PoseCounters()
        self.names: frozenset[str] = frozenset()
        """Names of the rigid bodies in the newest frame."""

    def poses(self, bodies: Sequence[TrackedBody]) -> list[Pose]:
        """Return the vehicle's poses in a frame, stamped with their capture.

        A pose with NaN, without a rotation, or not newer than the last is counted and dropped.
        """
        self.names = frozenset(body.name for body in bodies)
        if not self.body and len(self.names) > 1:
            return []
        result = []
        for body in bodies:
            if self.body not in ("", body.name):
                continue
            stamp_ns = body.stamp_ns - self._delay_ns
            norm = float(np.linalg.norm(body.attitude))
            if not (np.all(np.isfinite(body.position)) and abs(norm - 1.0) < _UNIT_TOLERANCE):
                self.counters.not_finite += 1
            elif stamp_ns <= self._last_ns:
                self.counters.not_newer += 1
            else:
                self._last_ns = stamp_ns
                self.counters.sent += 1
                position = rotate_vector(self._to_map, body.position)
                attitude = quaternion_multiply(self._to_map, body.attitude / norm)
                attitude = quaternion_multiply(attitude, self._to_body)
                result.append(Pose(stamp_ns, FRAME_MAP, position, attitude))
        return result

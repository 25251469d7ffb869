"""Whether a pose of the motion capture can be one at all, whoever takes it."""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array

FRAME = "map"
MAX_FUTURE_NS = 5_000_000
"""A stamp may be this far ahead of the clock: two clocks of one machine agree better."""
MAX_SQUARE_ERROR = 0.2
"""The square of a quaternion's length may be off by this: its length by a tenth."""


def check_pose(stamp_ns: int, now_ns: int, frame_id: str, position: Array, attitude: Array) -> str:
    """Return "" or why it can't be used: wrong_frame, not_finite, not_unit, future.

    Args:
        stamp_ns: time of capture.
        now_ns: time now, of the same clock.
        frame_id: must be `map`.
        position: (3) [m].
        attitude: (4) xyzw.
    """
    if frame_id.lstrip("/") != FRAME:
        return "wrong_frame"
    if not np.isfinite(position.sum() + attitude.sum()):
        return "not_finite"
    if abs(float(attitude @ attitude) - 1.0) > MAX_SQUARE_ERROR:
        return "not_unit"
    return "future" if stamp_ns > now_ns + MAX_FUTURE_NS else ""

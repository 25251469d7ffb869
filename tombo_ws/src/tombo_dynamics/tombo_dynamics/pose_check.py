"""Whether a pose of the motion capture can be one at all, whoever takes it."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.jit import compiled_call
from tombo_dynamics.messages import Reason

MAX_FUTURE_NS = 5_000_000
"""A stamp may be this far ahead of the clock: two clocks of one machine agree better."""
MAX_POSE_AGE_NS = 500_000_000
"""An older pose says nothing about the vehicle any more."""
_MAX_SQUARE_ERROR = 0.2
"""The square of a quaternion's length may be off by this: its length by a tenth."""


class PoseRefusal(Reason):
    """Why a pose is not used."""

    NONE = 0
    WRONG_FRAME = 1
    NOT_FINITE = 2
    NOT_UNIT = 3
    FUTURE = 4
    OUT_OF_ORDER = 5
    LATE = 6
    JUMP = 7
    TWO_PUBLISHERS = 8


POSE_REFUSAL_TEXTS = {
    PoseRefusal.WRONG_FRAME: f"a pose whose frame is not {FRAME_MAP}",
    PoseRefusal.NOT_FINITE: "a pose with NaN or infinity",
    PoseRefusal.NOT_UNIT: "a pose whose quaternion is no rotation",
    PoseRefusal.FUTURE: "a pose stamped in the future",
    PoseRefusal.OUT_OF_ORDER: "a pose not newer than the one before",
    PoseRefusal.LATE: "a pose that is too old when it arrives",
    PoseRefusal.JUMP: "a pose where the vehicle can't be: markers mixed up?",
    PoseRefusal.TWO_PUBLISHERS: "two nodes publish poses: which is true is unknown",
}


@compiled_call
def check_pose(
    stamp_ns: int, now_ns: int, max_age_ns: float, position: Array, attitude: Array
) -> PoseRefusal:
    """Return why a pose can't be used: NOT_FINITE, NOT_UNIT, FUTURE, LATE or NONE.

    Args:
        stamp_ns: time of capture.
        now_ns: time now, of the same clock.
        max_age_ns: largest time since the capture.
        position: (3) [m].
        attitude: (4) xyzw.
    """
    total = position[0] + position[1] + position[2]
    square = 0.0
    for i in range(4):
        total += attitude[i]
        square += attitude[i] * attitude[i]
    if not math.isfinite(total):
        return PoseRefusal.NOT_FINITE
    if abs(square - 1.0) > _MAX_SQUARE_ERROR:
        return PoseRefusal.NOT_UNIT
    if stamp_ns > now_ns + MAX_FUTURE_NS:
        return PoseRefusal.FUTURE
    if now_ns - stamp_ns > max_age_ns:
        return PoseRefusal.LATE
    return PoseRefusal.NONE

"""Whether a stamp, or a pose of the motion capture, can be right at all, whoever takes it."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import PositionSetpoint, Reason
from tombo_dynamics.vectors import all_finite

MAX_FUTURE_NS = 5_000_000
"""A stamp may be this far ahead: two clocks of one machine agree better."""


@compiled(inline=False)
def is_future(stamp_ns: int, now_ns: int) -> bool:
    """Return whether a stamp can't be right, because that time is yet to come.

    Args:
        stamp_ns: time of capture.
        now_ns: when the message was received, by the same clock. Whose clock is less sure than
            that adds what it may be behind: `Core.clock_slack_ns`, the error of a synchronisation.
    """
    return bool(stamp_ns > now_ns + MAX_FUTURE_NS)


@compiled(inline=False)
def is_finite_setpoint(setpoint: PositionSetpoint) -> bool:
    """Return whether no number of a set point is infinite or NaN."""
    moves = all_finite(setpoint.velocity) and all_finite(setpoint.acceleration)
    return moves and all_finite(setpoint.position) and math.isfinite(setpoint.yaw)


MAX_POSE_AGE_NS = 500_000_000
"""An older pose says nothing about the vehicle any more."""
_MAX_SQUARE_ERROR = 0.2
"""The square of a quaternion's length may be off by this: its length by a tenth."""


class PoseRefusal(Reason):
    """Why a pose is not used."""

    NONE = 0
    WRONG_FRAME = 1, f"a pose whose frame is not {FRAME_MAP}"
    NOT_FINITE = 2, "a pose with NaN or infinity"
    NOT_UNIT = 3, "a pose whose quaternion is no rotation"
    FUTURE = 4, "a pose stamped in the future"
    OUT_OF_ORDER = 5, "a pose not newer than the one before"
    LATE = 6, "a pose that is too old when it arrives"
    JUMP = 7, "a pose where the vehicle can't be: markers mixed up, or two bodies in one topic?"
    TWO_PUBLISHERS = 8, "two nodes publish poses: which is true is unknown"
    REPEATED = 9, "the same pose again, though the vehicle moves"
    DISTRUSTED = 10, "a pose of a motion capture that was judged wrong in this flight"


@compiled(inline=False)
def check_pose(
    stamp_ns: int, now_ns: int, max_age_ns: float, position: Array, attitude: Array
) -> PoseRefusal:
    """Return why a pose can't be used: NOT_FINITE, NOT_UNIT, FUTURE, LATE or NONE.

    Args:
        stamp_ns: time of capture.
        now_ns: when the pose was received, by the same clock.
        max_age_ns: largest time from the capture to then.
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
    if is_future(stamp_ns, now_ns):
        return PoseRefusal.FUTURE
    if now_ns - stamp_ns > max_age_ns:
        return PoseRefusal.LATE
    return PoseRefusal.NONE

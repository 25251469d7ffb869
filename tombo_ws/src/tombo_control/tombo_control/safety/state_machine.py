"""The states of the controller, and what leads from one to the next: one table.

The controller has the last word before the rotors. `TABLE` is what it does about every loss;
`next_state` looks it up, in the loops and in the model checker alike, and docs/safety.md is
printed from it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Reason


class SafetyState(Reason):
    """States of the controller, each with the text of its command."""

    OFF = 0, "rotors off; a take-off is obeyed"
    FLY = 1, "the set points, inside the flight volume"
    HOLD = 2, "the last set point, at rest"
    LAND = 3, "down at 0.4 m/s where it is, level once it no longer sinks; set points are ignored"
    BLIND = 4, "down at 0.35 m/s on gyro and accelerometer, braked; set points are ignored"
    STANDBY = 5, "nothing: the flight controller behind it lands the vehicle"
    LATCHED = 6, "rotors off until an operator has asked for another take-off"


ROTORS_OFF = (SafetyState.OFF, SafetyState.LATCHED, SafetyState.STANDBY)
"""States in which no rotor is commanded to turn."""


class Condition(Reason):
    """What leads to another state."""

    KILL = 0, "`~/kill`"
    ABORT = 1, "`~/abort`"
    NEW_FLIGHT = 2, "simulated clock set back: another flight"
    TAKEOFF = (
        3,
        "phase `takeoff` after phase `idle` (or, of a controller that has just started, after "
        "1.5 s at rest); position known, vehicle at rest, level, where it was last known "
        "(`takeoff_distance`), set point within 0.6 m",
    )
    TAKEOFF_REFUSED = 4, "phase `takeoff` after phase `idle`, but for 1 s one of these is not so"
    IN_FLIGHT = 5, "set points of a flight that the controller has not seen begin"
    COMMANDED = 6, "phase `idle` or `takeoff`, and an operator has asked for it since"
    DOWN = (
        7,
        "phase `idle` or `landed`, less than 0.15 m above the place of take-off; where that "
        "is not known, at rest for 1.5 s",
    )
    DOWN_ABOVE = 8, "phase `idle` or `landed`, but higher"
    POSITION_LOST = (
        9,
        "estimate older than `inputs.odometry_timeout`, pose behind it older than "
        "`control.blind_timeout`, or gyro silent for 0.1 s",
    )
    POSITION_BACK = (
        10,
        "position known for 0.3 s, within `return_time`, above 0.4 m, near where it was lost",
    )
    POSITION_LATE = 11, "position known for 0.3 s, but too late, too low or elsewhere"
    SETPOINT_SILENT = 12, "no set point for `inputs.setpoint_timeout`"
    SETPOINT_BACK = 13, "set points come"
    HOLD_OVER = 14, "held for `hold_time`"
    LIMIT = 15, "outside of the flight volume, too fast or too tilted for `limit_time`"
    LAND_STUCK = 16, "phase `land`, but for 3 s it has not sunk"
    TOUCHDOWN = (
        17,
        "the accelerometer shows more than the rotors give by `touchdown_push` of the weight, "
        "and gravity in all, at rest and level, for `touchdown_time`",
    )
    OVERTURNED = 18, "tilted by more than 1 rad, at rest, for 1 s"
    TIME_OVER = 19, "`blind_time` after a descent at half its speed would have ended"
    REPLACED = (
        20,
        "the gyro was silent for 0.1 s, and 1 s later the position is not known: a touchdown "
        "may have been missed, the flight controller behind it may have landed",
    )


class Row(NamedTuple):
    """In `state`, if `condition` holds and none of the rows above it: `then`."""

    state: SafetyState
    condition: Condition
    then: SafetyState


_S, _C = SafetyState, Condition
TABLE: tuple[Row, ...] = (
    Row(_S.OFF, _C.KILL, _S.LATCHED),
    Row(_S.OFF, _C.NEW_FLIGHT, _S.OFF),
    Row(_S.OFF, _C.TAKEOFF, _S.FLY),
    Row(_S.OFF, _C.TAKEOFF_REFUSED, _S.LATCHED),
    Row(_S.OFF, _C.IN_FLIGHT, _S.STANDBY),
    Row(_S.FLY, _C.KILL, _S.LATCHED),
    Row(_S.FLY, _C.NEW_FLIGHT, _S.OFF),
    Row(_S.FLY, _C.DOWN, _S.LATCHED),
    Row(_S.FLY, _C.POSITION_LOST, _S.BLIND),
    Row(_S.FLY, _C.ABORT, _S.LAND),
    Row(_S.FLY, _C.DOWN_ABOVE, _S.LAND),
    Row(_S.FLY, _C.LIMIT, _S.LAND),
    Row(_S.FLY, _C.LAND_STUCK, _S.LAND),
    Row(_S.FLY, _C.SETPOINT_SILENT, _S.HOLD),
    Row(_S.HOLD, _C.KILL, _S.LATCHED),
    Row(_S.HOLD, _C.NEW_FLIGHT, _S.OFF),
    Row(_S.HOLD, _C.DOWN, _S.LATCHED),
    Row(_S.HOLD, _C.POSITION_LOST, _S.BLIND),
    Row(_S.HOLD, _C.ABORT, _S.LAND),
    Row(_S.HOLD, _C.LIMIT, _S.LAND),
    Row(_S.HOLD, _C.HOLD_OVER, _S.LAND),
    Row(_S.HOLD, _C.SETPOINT_BACK, _S.FLY),
    Row(_S.LAND, _C.KILL, _S.LATCHED),
    Row(_S.LAND, _C.NEW_FLIGHT, _S.OFF),
    Row(_S.LAND, _C.TOUCHDOWN, _S.LATCHED),
    Row(_S.LAND, _C.OVERTURNED, _S.LATCHED),
    Row(_S.LAND, _C.DOWN, _S.LATCHED),
    Row(_S.LAND, _C.POSITION_LOST, _S.BLIND),
    Row(_S.LAND, _C.TIME_OVER, _S.LATCHED),
    Row(_S.BLIND, _C.KILL, _S.LATCHED),
    Row(_S.BLIND, _C.NEW_FLIGHT, _S.OFF),
    Row(_S.BLIND, _C.TOUCHDOWN, _S.LATCHED),
    Row(_S.BLIND, _C.OVERTURNED, _S.LATCHED),
    Row(_S.BLIND, _C.TIME_OVER, _S.LATCHED),
    Row(_S.BLIND, _C.REPLACED, _S.STANDBY),
    Row(_S.BLIND, _C.POSITION_BACK, _S.FLY),
    Row(_S.BLIND, _C.POSITION_LATE, _S.LAND),
    Row(_S.STANDBY, _C.KILL, _S.LATCHED),
    Row(_S.STANDBY, _C.NEW_FLIGHT, _S.OFF),
    Row(_S.STANDBY, _C.TAKEOFF, _S.FLY),
    Row(_S.STANDBY, _C.DOWN, _S.LATCHED),
    Row(_S.LATCHED, _C.NEW_FLIGHT, _S.OFF),
    Row(_S.LATCHED, _C.COMMANDED, _S.OFF),
)
"""First row that fits wins; where none fits the state stays."""

_ROWS = np.array(TABLE, dtype=np.int64)
_FIRST = np.array([next(i for i, r in enumerate(TABLE) if r.state == s) for s in SafetyState])
_LAST = np.array([max(i for i, r in enumerate(TABLE) if r.state == s) for s in SafetyState])
NO_ROW = -1


@compiled
def deciding_row(state: int, conditions: int) -> int:
    """Return the row of `TABLE` that decides, or `NO_ROW`.

    Args:
        state: a `SafetyState`.
        conditions: bit n is set where `Condition` n holds.
    """
    for i in range(_FIRST[state], _LAST[state] + 1):
        if conditions >> _ROWS[i, 1] & 1:
            return i
    return NO_ROW


@compiled
def row_condition(row: int) -> int:
    """Return the condition of a row of `TABLE`."""
    return int(_ROWS[row, 1])


@compiled
def row_next(row: int) -> int:
    """Return the state that a row of `TABLE` leads to."""
    return int(_ROWS[row, 2])

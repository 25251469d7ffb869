"""What the simulator writes down in every tick, and in which columns."""

from __future__ import annotations

from typing import Any, NamedTuple

_WIDTHS = {
    "position": 3,
    "velocity": 3,
    "attitude": 4,
    "rates": 3,
    "rotor_speed": 4,
    "rotor_thrust": 4,
    "fold": 4,
    "damage": 4,
    "contact_force": 3,
    "contact": 5,
    "gyro": 3,
    "accel": 3,
    "est_position": 3,
    "est_velocity": 3,
    "est_attitude": 4,
    "position_setpoint": 3,
    "velocity_setpoint": 3,
    "acceleration_setpoint": 3,
    "attitude_setpoint": 4,
    "rates_setpoint": 3,
    "thrust_setpoint": 1,
    "rotor_command": 4,
    "mode": 1,
    "wind": 3,
    "battery": 3,
}


def _columns() -> dict[str, slice]:
    table = {}
    start = 0
    for name, width in _WIDTHS.items():
        table[name] = slice(start, start + width)
        start += width
    return table


COLUMNS: dict[str, slice] = _columns()
"""Name -> columns of the log. Truth: position to contact (map ENU, body FLU, SI); `contact` is
touching (0/1), rotor (-1 frame) and the point in map. Then what the autopilot knew and wanted;
set points of velocity and acceleration are what the reference feeds forward."""
LOG_WIDTH: int = sum(_WIDTHS.values())


class _Starts(NamedTuple):
    """First column of each quantity, as constants for compiled code."""

    position: Any
    velocity: Any
    attitude: Any
    rates: Any
    rotor_speed: Any
    rotor_thrust: Any
    fold: Any
    damage: Any
    contact_force: Any
    contact: Any
    gyro: Any
    accel: Any
    est_position: Any
    est_velocity: Any
    est_attitude: Any
    position_setpoint: Any
    velocity_setpoint: Any
    acceleration_setpoint: Any
    attitude_setpoint: Any
    rates_setpoint: Any
    thrust_setpoint: Any
    rotor_command: Any
    mode: Any
    wind: Any
    battery: Any


AT = _Starts(**{name: columns.start for name, columns in COLUMNS.items()})

"""Rotor speeds and motor commands from message types of other projects, known by their types.

Fields and units are those of the definitions that docs/logs.md lists. All are taken in PX4's
order of a quad-X, which is that of ArduCopter and of Gazebo's X500 too; the checks compare it with
the motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tombo_bag.columns import ColumnTable
from tombo_dynamics.arrays import Array

PULSE_US = (1000.0, 2000.0)
"""Lengths of a servo pulse for the commands 0 and 1 [us]."""
_RPM = math.pi / 30.0
_DSHOT = 1999.0
"""Throttle of DShot for the command 1; PX4 logs it in the same field as pulses."""
_MIN_PULSE_SHARE = 0.95
"""Of the shortest pulse: smaller values are not pulses."""
_FIELDS: Mapping[str, tuple[str, ...]] = {
    "mavros_msgs/msg/ESCStatus": ("esc_status[{}].rpm",),
    "mavros_msgs/msg/ESCTelemetry": ("esc_telemetry[{}].rpm",),
    "actuator_msgs/msg/Actuators": ("velocity", "normalized"),
    "mav_msgs/msg/Actuators": ("angular_velocities", "normalized"),
    "mavros_msgs/msg/RCOut": ("channels",),
    "mavros_msgs/msg/HilActuatorControls": ("controls",),
}
"""Type → fields of the rotors, best first. Types too: the first with a channel counts."""
RANKS = {typename: rank for rank, typename in enumerate(_FIELDS)}
"""Type that may hold commands or speeds of rotors → its rank, 0 the best."""
_SHARED = ("channels", "controls")
"""Arrays of which only the first four elements are rotors."""


@dataclass(frozen=True)
class RotorReading:
    """Speeds or commands of four rotors."""

    channel: str
    values: Array
    """(N, 4), rad/s, or commands from 0 to 1; in the order of the message."""
    remark: str = ""


def rotor_reading(typename: str, topic: str, table: ColumnTable) -> RotorReading | None:
    """Return the rotors of a topic's messages; None: there are none, or other than four."""
    for field in _FIELDS.get(typename, ()):
        values = _four(table, field)
        if values is None or not values.any():
            continue
        if field.endswith("rpm"):
            return RotorReading("rotor_speed", _RPM * np.abs(values))
        if field == "channels":
            share = share_of_pulse(values)
            return None if share is None else RotorReading("motor_command", share)
        if field in ("normalized", "controls"):
            return RotorReading("motor_command", values)
        # RotorS publishes measured speeds by this type, too, as `motor_speed`
        asked = field == "velocity" or "command" in topic or "cmd" in topic
        channel = "rotor_command" if asked else "rotor_speed"
        return RotorReading(channel, np.abs(values), "the order depends on the model file")
    return None


def share_of_pulse(pulses: Array) -> Array | None:
    """Return commands, 0 to 1, of servo pulses [us] or of DShot; None: these are neither."""
    turning = pulses[pulses > 0.0]
    if not turning.size or not 0.2 * PULSE_US[0] < np.median(turning) < 1.2 * PULSE_US[1]:
        return None
    if np.quantile(turning, 0.005) < _MIN_PULSE_SHARE * PULSE_US[0]:
        return pulses / _DSHOT if turning.max() <= PULSE_US[1] else None
    return np.clip((pulses - PULSE_US[0]) / (PULSE_US[1] - PULSE_US[0]), 0.0, None)


def moving(candidates: Sequence[Array]) -> int:
    """Return which of several outputs (N, k) moves most, all its columns; else the first.

    All motors of a vehicle that flies move; a servo or an unconnected output does not.
    """
    spreads = [np.std(np.nan_to_num(c), axis=0).min(initial=np.inf) for c in candidates if len(c)]
    places = [i for i, c in enumerate(candidates) if len(c)]
    return places[int(np.argmax(spreads))] if places and max(spreads) > 0.0 else 0


def _four(table: ColumnTable, field: str) -> Array | None:
    """Return a field of four rotors (N, 4), an array or a field of each element."""
    columns = [table[name] for i in range(5) if (name := field.format(i)) in table]
    if "{}" not in field:
        columns = [*columns[0].T] if columns and columns[0].ndim == 2 else []
    if len(columns) < 4 or any(c.ndim != 1 or c.dtype.kind not in "fiu" for c in columns):
        return None
    values = np.column_stack(columns).astype(np.float64)
    others = 0.0 if field in _SHARED else np.nan_to_num(values[:, 4:])
    return None if np.any(others) or not np.isfinite(values[:, :4]).any() else values[:, :4]

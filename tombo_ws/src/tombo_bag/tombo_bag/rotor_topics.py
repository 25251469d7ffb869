"""Rotor speeds and motor commands from message types of other projects, known by their types.

Fields and units are those of the definitions that docs/logs.md lists. All are taken in PX4's
order of a quad-X, which is that of ArduCopter and of Gazebo's X500 too; the checks compare it with
the motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tombo_bag.columns import ColumnTable
from tombo_dynamics.arrays import Array

PULSE_US = (1000.0, 2000.0)
"""Length of a servo pulse that stands for 0 and for 1 [us]."""
_RPM = math.pi / 30.0
_DSHOT = 1999.0
"""Throttle of DShot that stands for 1; PX4 logs it beside pulses, in the same field."""
_SHORTEST = 0.95
"""Share of the shortest pulse below which values are no pulses."""
_SLOWED = "Gazebo may turn its joints slower than the rotors (rotorVelocitySlowdownSim)"


@dataclass(frozen=True)
class RotorReading:
    """What a message holds of the rotors."""

    channel: str
    values: Array
    """(N, 4), rad/s, or commands from 0 to 1; in the order of the message."""
    doubt: str = ""


def rotor_reading(typename: str, topic: str, table: ColumnTable) -> RotorReading | None:
    """Return what messages of a type say of four rotors; None: nothing."""
    reader = _READERS.get(typename)
    return None if reader is None else reader(topic, table)


def is_rotor_type(typename: str) -> bool:
    """Return whether messages of a type may hold commands or speeds of rotors."""
    return typename in _READERS


def share_of_pulse(pulses: Array) -> Array | None:
    """Return commands, 0 to 1, of servo pulses [us] or of DShot; None: these are neither."""
    turning = pulses[pulses > 0.0]
    if not turning.size or not 0.2 * PULSE_US[0] < np.median(turning) < 1.2 * PULSE_US[1]:
        return None
    if np.quantile(turning, 0.005) < _SHORTEST * PULSE_US[0]:
        return pulses / _DSHOT if turning.max() <= PULSE_US[1] else None
    return np.clip((pulses - PULSE_US[0]) / (PULSE_US[1] - PULSE_US[0]), 0.0, None)


def moving(candidates: Sequence[Array]) -> int:
    """Return which of several outputs (N, k) moves most, all its columns; else the first.

    Motors of a vehicle that flies all move; a servo, or what is not connected, does not.
    """
    return int(
        np.argmax(
            [
                np.std(np.nan_to_num(c), axis=0).min(initial=np.inf) if len(c) else 0.0
                for c in candidates
            ]
        )
    )


def _actuators(topic: str, table: ColumnTable) -> RotorReading | None:
    """Of Gazebo and RotorS: what is asked for, unless a topic of RotorS says `motor_speed`."""
    commanded = "velocity" in table or "command" in topic or "cmd" in topic
    for field in ("velocity", "angular_velocities"):
        speeds = None if _has_more(table, field) else _four(table, field)
        if speeds is not None:
            channel = "rotor_command" if commanded else "rotor_speed"
            return RotorReading(channel, np.abs(speeds), "the order depends on the model file")
    share = None if _has_more(table, "normalized") else _four(table, "normalized")
    return None if share is None else RotorReading("motor_command", share)


def _escs(name: str) -> Callable[[str, ColumnTable], RotorReading | None]:
    def read(topic: str, table: ColumnTable) -> RotorReading | None:
        columns = [table.get(f"{name}[{i}].rpm") for i in range(4)]
        fifth = table.get(f"{name}[4].rpm", np.zeros(1))
        if np.any(fifth) or any(c is None or c.dtype.kind not in "fiu" for c in columns):
            return None
        speeds = np.column_stack([np.asarray(c, np.float64) for c in columns if c is not None])
        return RotorReading("rotor_speed", _RPM * np.abs(speeds)) if np.any(speeds) else None

    return read


def _pulses(topic: str, table: ColumnTable) -> RotorReading | None:
    pulses = _four(table, "channels")
    share = None if pulses is None else share_of_pulse(pulses)
    return None if share is None else RotorReading("motor_command", share)


def _hil_controls(topic: str, table: ColumnTable) -> RotorReading | None:
    controls = _four(table, "controls")
    return None if controls is None else RotorReading("motor_command", controls)


def _joints(topic: str, table: ColumnTable) -> RotorReading | None:
    """Take joints with rotor, motor or prop in their names, in the order of these names."""
    speeds = table.get("velocity")
    if speeds is None or speeds.ndim != 2 or speeds.dtype.kind not in "fiu":
        return None
    names = {key: str(column[0]) for key, column in table.items() if key.startswith("name[")}
    rotors = sorted(
        (joint, int(key[5:-1]))
        for key, joint in names.items()
        if any(word in joint.lower() for word in ("rotor", "motor", "prop"))
    )
    if len(rotors) != 4 or speeds.shape[1] != len(names):
        return None
    columns = [i for _, i in rotors]
    return RotorReading("rotor_speed", np.abs(speeds[:, columns].astype(np.float64)), _SLOWED)


def _has_more(table: ColumnTable, field: str) -> bool:
    """Return whether an array holds more than four rotors: no quadrotor's."""
    values = table.get(field)
    return values is not None and values.ndim == 2 and bool(np.nan_to_num(values[:, 4:]).any())


def _four(table: ColumnTable, field: str) -> Array | None:
    """Return the first four numbers of an array, (N, 4), where all messages have them."""
    values = table.get(field)
    if values is None or values.ndim != 2 or values.shape[1] < 4 or values.dtype.kind not in "fiu":
        return None
    first = values[:, :4].astype(np.float64)
    return first if np.isfinite(first).any() else None


_READERS: Mapping[str, Callable[[str, ColumnTable], RotorReading | None]] = {
    "mavros_msgs/msg/ESCStatus": _escs("esc_status"),
    "mavros_msgs/msg/ESCTelemetry": _escs("esc_telemetry"),
    "actuator_msgs/msg/Actuators": _actuators,
    "mav_msgs/msg/Actuators": _actuators,
    "sensor_msgs/msg/JointState": _joints,
    "mavros_msgs/msg/RCOut": _pulses,
    "mavros_msgs/msg/HilActuatorControls": _hil_controls,
}
"""Best first, where several hold the same channel."""
RANKS = {typename: rank for rank, typename in enumerate(_READERS)}

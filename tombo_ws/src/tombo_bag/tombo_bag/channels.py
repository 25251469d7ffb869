"""Channels: short names of the measured quantities that checks and diagnosis read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    BATTERY,
    IMU,
    MOCAP_POSE,
    ODOMETRY,
    RATES_SETPOINT,
    ROTOR_COMMAND,
    SETPOINT,
)

ROTOR_SPEED = "/rotor_speed"
"""Measured rotor speeds, as tombo_msgs/RotorSpeeds; the suite itself publishes none."""


@dataclass(frozen=True)
class Channel:
    """A measured quantity, with the topic and the field of its messages."""

    topic: str
    field: str
    width: int
    unit: str
    doc: str


CHANNELS: Mapping[str, Channel] = {
    "position": Channel(MOCAP_POSE.name, "position", 3, "m", "motion capture, map (ENU)"),
    "attitude": Channel(
        MOCAP_POSE.name,
        "attitude",
        4,
        "1",
        "motion capture, quaternion xyzw, map from base_link (FLU)",
    ),
    "gyro": Channel(IMU.name, "gyro", 3, "rad/s", "body rates, base_link (FLU)"),
    "accel": Channel(
        IMU.name, "accel", 3, "m/s^2", "specific force, base_link (FLU); at rest +9.81 on z"
    ),
    "acceleration": Channel(
        "/estimator/acceleration",
        "acceleration",
        3,
        "m/s^2",
        "of an estimator, map (ENU), without gravity: at rest 0",
    ),
    "rotor_speed": Channel(
        ROTOR_SPEED, "speed", 4, "rad/s", "measured, positive, in the order of ROTOR_NAMES"
    ),
    "rotor_command": Channel(
        ROTOR_COMMAND.name,
        "speed",
        4,
        "rad/s",
        "rotor speeds asked for, in the order of ROTOR_NAMES",
    ),
    "motor_command": Channel(
        "/motor_command",
        "command",
        4,
        "1",
        "0 to 1, where no speed is asked for; order of ROTOR_NAMES",
    ),
    "voltage": Channel(BATTERY.name, "voltage", 1, "V", "supply"),
    "current": Channel(BATTERY.name, "current", 1, "A", "supply"),
}
"""All that the diagnosis can use. Topics that the suite does not have are those of logs alone."""
CONTROL_CHANNELS: Mapping[str, Channel] = {
    "estimated_position": Channel(ODOMETRY.name, "position", 3, "m", "of the estimator, map"),
    "estimated_attitude": Channel(
        ODOMETRY.name, "attitude", 4, "1", "of the estimator, xyzw, map from base_link"
    ),
    "estimated_velocity": Channel(
        "/estimator/velocity", "velocity", 3, "m/s", "of the estimator, map"
    ),
    "estimated_body_velocity": Channel(
        ODOMETRY.name, "velocity", 3, "m/s", "of the estimator, base_link"
    ),
    "position_setpoint": Channel(SETPOINT.name, "position", 3, "m", "asked for, map"),
    "velocity_setpoint": Channel(SETPOINT.name, "velocity", 3, "m/s", "fed forward, map"),
    "acceleration_setpoint": Channel(
        SETPOINT.name, "acceleration", 3, "m/s^2", "fed forward, map, without gravity"
    ),
    "attitude_setpoint": Channel(
        ATTITUDE_SETPOINT.name, "orientation", 4, "1", "of the position loop, xyzw"
    ),
    "thrust_setpoint": Channel(
        ATTITUDE_SETPOINT.name, "thrust", 1, "N", "of the position loop, sum of the rotors"
    ),
    "rates_setpoint": Channel(
        RATES_SETPOINT.name, "rates", 3, "rad/s", "of the attitude loop, base_link"
    ),
    "torque_setpoint": Channel(
        "/torque_setpoint", "torque", 3, "N m", "of the rate loop, base_link"
    ),
}
"""What controllers estimate and ask for: gains are identified from it (`tombo_diagnosis.control`);
the physics is not compared with it."""
ALL_CHANNELS: Mapping[str, Channel] = {**CHANNELS, **CONTROL_CHANNELS}
ROTOR_SPEEDS = ("rotor_speed", "rotor_command")
"""Channels in rad/s, measured ones first."""
DRIVES = (*ROTOR_SPEEDS, "motor_command")
"""Channels of the rotors' speeds and commands, best first."""

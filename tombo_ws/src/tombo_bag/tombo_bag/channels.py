"""What is measured in a flight, by short names: the channels that checks and diagnosis read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tombo_bag.topics import BATTERY, IMU, MOCAP_POSE, ROTOR_COMMAND

ROTOR_SPEED = "/rotor_speed"
"""Measured rotor speeds, as tombo_msgs/RotorSpeeds; the suite itself publishes none."""


@dataclass(frozen=True)
class Channel:
    """What a channel holds, and the topic and the field of its messages where it stands."""

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
ROTOR_SPEEDS = ("rotor_speed", "rotor_command")
"""Channels in rad/s, measured ones first."""
DRIVES = (*ROTOR_SPEEDS, "motor_command")
"""Channels that tell what the rotors do, best first."""

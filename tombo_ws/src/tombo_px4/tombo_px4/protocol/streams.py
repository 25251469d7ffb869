"""Which messages a link carries, and when each is due."""

from __future__ import annotations

from collections.abc import Mapping

from pymavlink.dialects.v20 import common as mavlink

_DEFAULT_HZ: dict[str, dict[str, float]] = {
    # As measured on the on-board link of PX4 1.17 (SITL).
    "onboard": {
        "HEARTBEAT": 1.0,
        "ATTITUDE": 100.0,
        "ATTITUDE_QUATERNION": 50.0,
        "HIGHRES_IMU": 50.0,
        "LOCAL_POSITION_NED": 30.0,
        "ODOMETRY": 30.0,
        "GLOBAL_POSITION_INT": 50.0,
        "ATTITUDE_TARGET": 10.0,
        "POSITION_TARGET_LOCAL_NED": 10.0,
        "ALTITUDE": 10.0,
        "SERVO_OUTPUT_RAW": 10.0,
        "VFR_HUD": 10.0,
        "SYS_STATUS": 5.0,
        "EXTENDED_SYS_STATE": 5.0,
        "GPS_RAW_INT": 5.0,
        "ESTIMATOR_STATUS": 1.0,
        "SYSTEM_TIME": 1.0,
        "VIBRATION": 0.5,
        "HOME_POSITION": 0.4,
        "BATTERY_STATUS": 0.4,
    },
    "ground": {
        "HEARTBEAT": 1.0,
        "ATTITUDE": 20.0,
        "ATTITUDE_QUATERNION": 10.0,
        "LOCAL_POSITION_NED": 10.0,
        "GLOBAL_POSITION_INT": 5.0,
        "VFR_HUD": 4.0,
        "ATTITUDE_TARGET": 2.0,
        "POSITION_TARGET_LOCAL_NED": 2.0,
        "SYS_STATUS": 1.0,
        "EXTENDED_SYS_STATE": 1.0,
        "ALTITUDE": 1.0,
        "GPS_RAW_INT": 1.0,
        "SERVO_OUTPUT_RAW": 1.0,
        "SYSTEM_TIME": 1.0,
        "ESTIMATOR_STATUS": 0.5,
        "HOME_POSITION": 0.5,
        "BATTERY_STATUS": 0.5,
        "VIBRATION": 0.1,
    },
}
_FAST = {
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "HIGHRES_IMU",
    "LOCAL_POSITION_NED",
    "ODOMETRY",
    "HIL_STATE_QUATERNION",
    "ATTITUDE_TARGET",
    "POSITION_TARGET_LOCAL_NED",
    "GLOBAL_POSITION_INT",
    "SERVO_OUTPUT_RAW",
}
_SHORTEST_US = 4_000
"""As fast as PX4 publishes its state: 250 Hz."""
_SHORTEST_SLOW_US = 20_000
_NEVER = 2**63
_STAGGER_US = 1_000


class StreamTable:
    """When each message of a link is due. Time is the vehicle's, in us since boot."""

    def __init__(self, stream_set: str, offered: Mapping[int, str], boot_us: int) -> None:
        """Begin with the default rates.

        Args:
            stream_set: `onboard` or `ground`.
            offered: number and name of every message that can be sent.
            boot_us: time now.
        """
        numbers = {name: number for number, name in offered.items()}
        self._offered = offered
        self._default = {
            numbers[name]: round(1e6 / rate) for name, rate in _DEFAULT_HZ[stream_set].items()
        }
        self._interval = dict(self._default)
        self._due = {number: boot_us + i * _STAGGER_US for i, number in enumerate(self._interval)}
        self.next_us = min(self._due.values())
        """When the next message is due."""

    def take_due(self, boot_us: int) -> list[int]:
        """Return the messages that are due now; each is due again after its interval."""
        if boot_us < self.next_us:
            return []
        taken = []
        for number, due in self._due.items():
            if due <= boot_us:
                interval = self._interval[number]
                # what was missed is not made up for
                self._due[number] = (due if due + interval > boot_us else boot_us) + interval
                taken.append(number)
        self._find_next()
        return taken

    def set_interval(self, number: int, interval_us: float, boot_us: int) -> bool:
        """Change how often a message is sent.

        Args:
            number: of the message.
            interval_us: time between two; 0: the default of the link, below 0: never.
            boot_us: time now.

        Returns:
            False: there is no such message, or it is HEARTBEAT, which nobody may change.
        """
        if number not in self._offered or number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return False
        if abs(interval_us) < 1e-5:
            wanted = self._default.get(number, 0)
        elif interval_us < 0.0:
            wanted = 0
        else:
            fast = self._offered[number] in _FAST
            shortest = _SHORTEST_US if fast else _SHORTEST_SLOW_US
            wanted = round(min(max(interval_us, shortest), 1e12))
        if wanted:
            self._interval[number] = wanted
            self._due[number] = min(self._due.get(number, boot_us), boot_us + wanted)
        else:
            self._interval.pop(number, None)
            self._due.pop(number, None)
        self._find_next()
        return True

    def interval(self, number: int) -> int:
        """Return the interval [us]; -1: never sent, 0: there is no such message."""
        if number not in self._offered:
            return 0
        return self._interval.get(number, -1)

    def _find_next(self) -> None:
        self.next_us = min(self._due.values(), default=_NEVER)

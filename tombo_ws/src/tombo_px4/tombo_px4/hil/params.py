"""Parameters of the simulator link to a real PX4: its rate, its sensors, its place on earth."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.errors import InputError
from tombo_dynamics.params import param, validate
from tombo_dynamics.time_base import TICK_HZ
from tombo_px4.link.link_params import plain

MAPPINGS = ("thrust", "speed")


@dataclass(frozen=True)
class HilParams:
    """Sensors and messages that PX4 receives, and their rates.

    PX4 calls a sensor that repeats a value a hundred times broken, so noise is never 0.
    """

    rate: float = param(
        250.0,
        "Hz",
        (250.0, 1000.0),
        "HIL_SENSOR messages: 250, 333, 500 or 1000; PX4's IMU_INTEG_RATE must be the same",
        "PX4's: 250",
    )
    mapping: str = plain(
        "thrust",
        "control 0..1, from idle up: linear in rotor thrust (as jMAVSim) or speed (as Gazebo)",
    )
    gps: bool = plain(True, "send HIL_GPS")
    gps_rate: float = param(10.0, "Hz", (1.0, 50.0), "HIL_GPS messages", "PX4's simulators")
    mocap: bool = plain(
        False,
        "send the motion capture's poses as ODOMETRY on this link; PX4 takes the time of arrival "
        "for that of capture (EKF2_EV_DELAY)",
    )
    truth_rate: float = param(
        0.0, "Hz", (0.0, 1000.0), "HIL_STATE_QUATERNION messages; 0: as PX4 asks for", "PX4: 200"
    )
    latitude: float = param(47.397742, "deg", (-89.0, 89.0), "of the origin of map", "PX4's SITL")
    longitude: float = param(
        8.545594, "deg", (-180.0, 180.0), "of the origin of map", "PX4's SITL"
    )
    altitude: float = param(488.0, "m", (-500.0, 10e3), "of the origin of map", "PX4's SITL")
    declination: float = param(
        3.3, "deg", (-180.0, 180.0), "of the earth's field, east positive", "PX4's WMM table"
    )
    inclination: float = param(
        63.1, "deg", (-90.0, 90.0), "of the earth's field, down positive", "PX4's WMM table"
    )
    field_strength: float = param(
        0.48, "gauss", (0.2, 0.7), "of the earth's field", "PX4's WMM table"
    )
    gyro_noise: float = param(
        0.002,
        "rad/s",
        (1e-4, 0.1),
        "standard deviation of a message, besides effects.imu_noise",
        "estimated, because: twice the step of PX4's own reading, so it never stands still",
    )
    accel_noise: float = param(
        0.02,
        "m/s^2",
        (1e-3, 1.0),
        "standard deviation of a message, besides effects.imu_noise",
        "as gyro_noise",
    )
    mag_noise: float = param(
        0.002, "gauss", (1e-5, 0.1), "standard deviation", "estimated, because: 0.2 degrees"
    )
    pressure_noise: float = param(
        0.5, "Pa", (1e-3, 50.0), "standard deviation", "estimated, because: 4 cm of height"
    )
    gps_position_noise: float = param(
        0.1, "m", (0.0, 10.0), "standard deviation of each axis", "estimated, because: open sky"
    )
    gps_velocity_noise: float = param(
        0.05, "m/s", (0.0, 5.0), "standard deviation of each axis", "as gps_position_noise"
    )

    @property
    def ticks(self) -> int:
        """Ticks of 1 ms between two HIL_SENSOR."""
        return round(TICK_HZ / self.rate)

    def check(self) -> HilParams:
        """Return the record if it can be used.

        Raises:
            InputError: out of bounds, no whole number of ms, an unknown mapping.
        """
        validate(self, "hil")
        if abs(self.rate * self.ticks - TICK_HZ) > 2.0:
            raise InputError(
                f"hil.rate: {self.rate:g} Hz is no whole number of ms; accepted: 250, 333, 500 or "
                "1000 [Hz]"
            )
        if self.mapping not in MAPPINGS:
            raise InputError(
                f"hil.mapping: '{self.mapping}' is unknown; accepted: {', '.join(MAPPINGS)}"
            )
        return self

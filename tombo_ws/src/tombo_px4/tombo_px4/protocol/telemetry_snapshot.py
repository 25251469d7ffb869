"""The vehicle at one tick in NED and FRD; each quantity is computed once.

Also who the vehicle is (a PX4 1.17 quadrotor), and numbers scaled into MAVLink's integer fields.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import Plant
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.frames import (
    PX4_ROTORS,
    GeoOrigin,
    euler,
    frd_from_flu,
    ned_from_enu,
    px4_quaternion,
)
from tombo_px4.link.extra_messages import ProtocolVersion

if TYPE_CHECKING:
    from tombo_control.estimate import StampedEstimate
    from tombo_px4.autopilot.vehicle import Px4Vehicle
    from tombo_px4.autopilot.vehicle_state import ArmingHealth

INT16 = (-32767, 32767)
INT32 = (-(2**31) + 1, 2**31 - 1)


def fitted(value: float, bounds: tuple[int, int], unknown: int = 0) -> int:
    """Return the nearest whole number within bounds; `unknown` for NaN."""
    if math.isnan(value):
        return unknown
    low, high = bounds
    return round(min(max(value, low), high))


def globe_fields(place: tuple[float, float, float]) -> tuple[int, int, int]:
    """Return latitude, longitude [1e-7 deg] and altitude [mm] of degrees and metres."""
    latitude, longitude, altitude = place
    return fitted(1e7 * latitude, INT32), fitted(1e7 * longitude, INT32), millimetres(altitude)


def millimetres(value: float) -> int:
    """Return metres in millimetres."""
    return fitted(1e3 * value, INT32)


def centi(value: float) -> int:
    """Return a value in hundredths, in 16 bits: cm/s of m/s, cA of A."""
    return fitted(1e2 * value, INT16)


def heading(degrees: float) -> int:
    """Return an angle in hundredths of a degree, 0 to 35999."""
    return fitted(100.0 * degrees, (0, 36000)) % 36000


_SEA_LEVEL_PA, _SEA_LEVEL_K, _LAPSE_K_M, _EXPONENT = 101_325.0, 288.15, 0.0065, 5.25588
"""International standard atmosphere, up to 11 km."""


def temperature_at(altitude: float) -> float:
    """Return the temperature [deg C] of the standard atmosphere at an altitude [m]."""
    return 15.0 - _LAPSE_K_M * altitude


def pressure_at(altitude: float) -> float:
    """Return the pressure [Pa] of the standard atmosphere at an altitude [m]."""
    return float(_SEA_LEVEL_PA * (1.0 - _LAPSE_K_M * altitude / _SEA_LEVEL_K) ** _EXPONENT)


def altitude_at(pressure: float) -> float:
    """Return the altitude [m] of a pressure [Pa] in the standard atmosphere."""
    cooler = 1.0 - (pressure / _SEA_LEVEL_PA) ** (1.0 / _EXPONENT)
    return float(cooler * _SEA_LEVEL_K / _LAPSE_K_M)


def ground_truth(mav: Any, time_us: int, origin: GeoOrigin, plant: Plant) -> Any:
    """Return HIL_STATE_QUATERNION: the ground truth, as PX4's simulators send it."""
    state = plant.state
    rates, force = frd_from_flu(np.stack([state.rates, plant.force]))
    to_milli_g = 1000.0 / GRAVITY / float(plant.mass)
    air_speed = fitted(100.0 * math.sqrt(float(plant.airspeed @ plant.airspeed)), (0, 65_535))
    return mav.hil_state_quaternion_encode(
        time_us,
        numbers(px4_quaternion(state.attitude)),
        *numbers(rates),
        *globe_fields(origin.global_of(state.position)),
        *(centi(v) for v in numbers(ned_from_enu(state.velocity))),
        air_speed,
        air_speed,
        *(fitted(to_milli_g * f, INT16) for f in numbers(force)),
    )


_VERSION = 1 << 24 | 17 << 16 | 0 << 8 | 255
"""1.17.0; 255: a release, `FIRMWARE_VERSION_TYPE_OFFICIAL`."""
CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
"""No missions, no file transfer: what is not simulated is not claimed."""
_CUSTOM = list(b"tombosim")
_UID = 0x544F4D424F
"""Any number but 0, which clients take for "has none"."""


def autopilot_version(mav: Any) -> Any:
    """Return AUTOPILOT_VERSION."""
    uid = list(_UID.to_bytes(18, "big"))
    return mav.autopilot_version_encode(
        CAPABILITIES, _VERSION, _VERSION, 0, 0, _CUSTOM, _CUSTOM, 8 * [0], 0, 0, _UID, uid
    )


def protocol_version() -> Any:
    """Return PROTOCOL_VERSION: MAVLink 2.0, nothing older is spoken."""
    return ProtocolVersion(200, 200, 200, 8 * [0], 8 * [0])


Vector = list[float]


class TelemetrySnapshot:
    """A view of the vehicle, valid for the tick it was taken at."""

    def __init__(self, vehicle: Px4Vehicle, origin: GeoOrigin) -> None:
        self.vehicle = vehicle
        self.origin = origin
        self.boot_us = vehicle.boot_us
        self.boot_ms = self.boot_us // 1000 % 2**32
        self.load = 0.0
        self.unix_us = 0
        """Both as in `Telemetry`."""

    @cached_property
    def estimate(self) -> StampedEstimate:
        """Estimate of the autopilot."""
        return self.vehicle.estimate

    @cached_property
    def health(self) -> ArmingHealth:
        """Reasons that deny arming, and what is known."""
        return self.vehicle.health

    @cached_property
    def position(self) -> Vector:
        """NED [m]."""
        return numbers(ned_from_enu(self.estimate.position))

    @cached_property
    def velocity(self) -> Vector:
        """NED [m/s]."""
        return numbers(ned_from_enu(self.estimate.velocity))

    @cached_property
    def attitude(self) -> Vector:
        """Quaternion wxyz, NED from FRD."""
        return numbers(px4_quaternion(self.estimate.attitude))

    @cached_property
    def angles(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw [rad]."""
        return euler(self.attitude)

    @cached_property
    def rates(self) -> Vector:
        """FRD [rad/s], bias removed."""
        return numbers(frd_from_flu(self.estimate.rates))

    @cached_property
    def variances(self) -> tuple[Vector, Vector]:
        """Of pose and motion, as `Ekf2Model.variances`, with the position in axes of NED."""
        (east, north, up, *angles), motion = self.vehicle.ekf2_model.variances(self.vehicle.tick)
        return [north, east, up, *angles], [*motion]

    @cached_property
    def heading_deg(self) -> float:
        """Clockwise from north, 0 to 360."""
        return math.degrees(self.angles[2]) % 360.0

    @cached_property
    def height(self) -> float:
        """Estimated height in map [m]."""
        return float(self.estimate.position[2])

    @cached_property
    def height_above_home(self) -> float:
        """Estimated height above home [m]."""
        return self.height - float(self.vehicle.home[2])

    @cached_property
    def globe(self) -> tuple[float, float, float]:
        """Latitude [deg], longitude [deg], altitude [m]."""
        return self.origin.global_of(self.estimate.position)

    @cached_property
    def imu(self) -> Vector:
        """Gyro [rad/s] and specific force [m/s^2], FRD, as measured."""
        measured = self.vehicle.simulator.imu
        return [*numbers(frd_from_flu(measured[:3])), *numbers(frd_from_flu(measured[3:]))]

    @cached_property
    def normalized_rotor_speeds(self) -> Vector:
        """What PX4's motors 1 to 4 are asked for, as shares of the highest speed."""
        shares = self.vehicle.normalized_rotor_speeds
        return [min(max(float(shares[rotor]), 0.0), 1.0) for rotor in PX4_ROTORS]


def numbers(values: Array) -> Vector:
    """Return plain numbers, which MAVLink's encoder takes faster."""
    plain: Vector = values.tolist()
    return plain

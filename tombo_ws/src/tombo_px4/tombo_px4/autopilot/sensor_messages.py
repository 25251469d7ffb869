"""Messages with sensor samples, and with the ground truth."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.rotation import conjugate, rotate_vectors
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.frames import enu_from_ned, frd_from_flu, px4_quaternion
from tombo_px4.protocol.field_scaling import INT16, centi, fitted, globe_fields, heading
from tombo_px4.protocol.telemetry_snapshot import TelemetrySnapshot, numbers

_EARTH_FIELD = enu_from_ned((0.21, 0.01, 0.43))
"""ENU [gauss], Zurich."""
_SEA_LEVEL_HPA = 1013.25
_GROUND_TEMPERATURE_C = 25.0
_FIELDS = 0x3F | 0x1C0 | 0x200 | 0x800 | 0x1000
"""HIGHRES_IMU carries accelerometer, gyro, magnetometer, pressure, its altitude, temperature."""
_SATELLITES = 16
_EPH = 25
"""Dilution of precision, 1e-2."""


def highres_imu(mav: Any, p: TelemetrySnapshot) -> Any:
    """Return HIGHRES_IMU: the IMU sample of the tick; field and air without noise."""
    gyro, force = p.imu[:3], p.imu[3:]
    height = p.origin.altitude_m + float(p.truth[2])
    pressure = _SEA_LEVEL_HPA * (1.0 - 2.25577e-5 * height) ** 5.25588
    return mav.highres_imu_encode(
        p.boot_us,
        *force,
        *gyro,
        *numbers(frd_from_flu(rotate_vectors(conjugate(p.truth[3:7]), _EARTH_FIELD))),
        pressure,
        0.0,
        height,
        _GROUND_TEMPERATURE_C,
        _FIELDS,
    )


def gps_raw(mav: Any, p: TelemetrySnapshot) -> Any:
    """Return GPS_RAW_INT, if there is a receiver."""
    if not p.vehicle.parameters.get("SYS_HAS_GPS"):
        return None
    north, east, _ = p.true_velocity
    speed = math.hypot(north, east)
    course = math.degrees(math.atan2(east, north)) % 360.0
    return mav.gps_raw_int_encode(
        p.boot_us,
        mavlink.GPS_FIX_TYPE_RTK_FIXED,
        *globe_fields(p.origin.global_of(p.truth[:3])),
        _EPH,
        _EPH,
        fitted(100.0 * speed, (0, 65534), 65535),
        heading(course),
        _SATELLITES,
    )


def ground_truth(mav: Any, p: TelemetrySnapshot) -> Any:
    """Return HIL_STATE_QUATERNION: the ground truth, as PX4's simulators send it."""
    truth = p.truth
    milli_g = 1000.0 / GRAVITY
    return mav.hil_state_quaternion_encode(
        p.boot_us,
        numbers(px4_quaternion(truth[3:7])),
        *numbers(frd_from_flu(truth[10:13])),
        *globe_fields(p.origin.global_of(truth[:3])),
        *(centi(v) for v in p.true_velocity),
        0,
        0,
        *(fitted(milli_g * a, INT16) for a in p.imu[3:]),
    )

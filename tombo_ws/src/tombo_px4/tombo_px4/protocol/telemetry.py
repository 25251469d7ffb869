"""Telemetry of the vehicle: one table of messages, their rates on each link, what builds them.

Each is stamped with its tick, in NED and FRD. The vehicle is a PX4 1.17 quadrotor. Numbers are
scaled into MAVLink's integer fields.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.rotation import conjugate, rotate_vector, yaw_pitch_roll
from tombo_px4.frames import (
    UPPER_DIAGONAL,
    GeoOrigin,
    enu_from_ned,
    frd_from_flu,
    ned_from_enu,
    px4_quaternion,
)
from tombo_px4.modes import MavLandedState, custom_mode

if TYPE_CHECKING:
    from tombo_px4.autopilot.vehicle import Px4Vehicle

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


class VehicleView:
    """The vehicle at its present tick, in PX4's frames."""

    def __init__(self, vehicle: Px4Vehicle, origin: GeoOrigin) -> None:
        estimate = vehicle.estimate
        self.vehicle = vehicle
        self.origin = origin
        self.known = vehicle.situation
        self.boot_us = vehicle.boot_us
        self.boot_ms = vehicle.boot_us // 1000 % 2**32
        self.position: list[float] = ned_from_enu(estimate.position).tolist()
        self.velocity: list[float] = ned_from_enu(estimate.velocity).tolist()
        self.attitude: list[float] = px4_quaternion(estimate.attitude).tolist()
        self.angles = yaw_pitch_roll(np.roll(self.attitude, -1))[::-1].tolist()
        self.rates: list[float] = frd_from_flu(estimate.rates).tolist()
        self.heading_deg = math.degrees(self.angles[2]) % 360.0
        self.height = float(estimate.position[2])


Fields = tuple[Any, ...] | None
_NAN = math.nan
_EARTH_FIELD = enu_from_ned((0.21, 0.01, 0.43))
"""ENU [gauss], Zurich."""
_GROUND_TEMPERATURE_C = 25.0
_FIELDS = 0x3F | 0x1C0 | 0x200 | 0x800 | 0x1000
"""HIGHRES_IMU carries accelerometer, gyro, magnetometer, pressure, its altitude, temperature."""
_SATELLITES = 16
_EPH = 25
"""Dilution of precision, 1e-2."""
_CELLS, _CELL_UNUSED = 3, 65535
_TURN_VARIANCE = 1e-4
"""Of angles [rad^2] and rates [rad^2/s^2]."""
_NO_VTOL = mavlink.MAV_VTOL_STATE_UNDEFINED
_VERSION = 1 << 24 | 17 << 16 | 0 << 8 | 255
"""1.17.0; 255: a release, `FIRMWARE_VERSION_TYPE_OFFICIAL`."""
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
"""No missions, no file transfer: it contains simulated states only."""
_CUSTOM = list(b"tombosim")
_UID = 0x544F4D424F
"""Any number but 0, which clients take for "has none"."""


def _heartbeat(view: VehicleView) -> Fields:
    vehicle = view.vehicle
    state = mavlink.MAV_STATE_CRITICAL if vehicle.failsafe else mavlink.MAV_STATE_ACTIVE
    if not vehicle.armed:
        state = mavlink.MAV_STATE_UNINIT if vehicle.problems else mavlink.MAV_STATE_STANDBY
    if vehicle.killed:
        state = mavlink.MAV_STATE_FLIGHT_TERMINATION
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if vehicle.armed else 0
    return (
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed,
        custom_mode(vehicle.mode),
        state,
        3,
    )


def _system_status(view: VehicleView) -> Fields:
    vehicle, known, battery = view.vehicle, view.known, view.vehicle.battery
    get = vehicle.parameters.get
    sensors = {
        mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO: True,
        mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL: True,
        mavlink.MAV_SYS_STATUS_AHRS: known.attitude,
        mavlink.MAV_SYS_STATUS_SENSOR_BATTERY: battery.warning < 2,
        mavlink.MAV_SYS_STATUS_PREARM_CHECK: not vehicle.problems,
    }
    if get("SYS_HAS_MAG"):
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG] = True
    if get("SYS_HAS_BARO"):
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE] = True
    if get("SYS_HAS_GPS"):
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_GPS] = known.global_position
    if vehicle.ekf2_model.source == "vision":
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION] = known.local_position
    return (
        sum(sensors),
        sum(sensors),
        sum(bit for bit, is_healthy in sensors.items() if is_healthy),
        0,
        fitted(1e3 * battery.voltage, (0, 65534), 65535),
        fitted(100.0 * battery.current, (0, 32767), -1),
        fitted(100.0 * battery.remaining, (0, 100), -1),
        *(6 * [0]),
    )


def _battery_status(view: VehicleView) -> Fields:
    battery = view.vehicle.battery
    cell = fitted(1e3 * battery.voltage / _CELLS, (0, 65534), _CELL_UNUSED)
    return (
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        _CELLS * [cell] + (10 - _CELLS) * [_CELL_UNUSED],
        fitted(100.0 * battery.current, (0, 32767), -1),
        -1,
        -1,
        fitted(100.0 * battery.remaining, (0, 100), -1),
        0,
        mavlink.MAV_BATTERY_CHARGE_STATE_OK + battery.warning,  # low, critical, emergency
    )


def _local_position(view: VehicleView) -> Fields:
    known = view.known.local_position
    return (view.boot_ms, *view.position, *view.velocity) if known else None


def _global_position(view: VehicleView) -> Fields:
    if not view.known.global_position:
        return None
    return (
        view.boot_ms,
        *globe_fields(view.origin.global_of(view.vehicle.estimate.position)),
        millimetres(view.height - float(view.vehicle.home[2])),
        *(fitted(1e2 * v, INT16) for v in view.velocity),
        heading(view.heading_deg),
    )


def _odometry(view: VehicleView) -> Fields:
    """Return ODOMETRY; its covariances have a diagonal alone, as PX4's."""
    if not view.known.local_position:
        return None
    place, speed = view.vehicle.ekf2_model.variances(view.vehicle.tick)
    pose, motion = 21 * [_NAN], 21 * [_NAN]
    for axis, entry in enumerate(UPPER_DIAGONAL):
        pose[entry] = place if axis < 3 else _TURN_VARIANCE
        motion[entry] = speed if axis < 3 else _TURN_VARIANCE
    return (
        view.boot_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,  # EKF2 gives the velocity in the axes of the position
        *view.position,
        view.attitude,
        *view.velocity,
        *view.rates,
        pose,
        motion,
        view.vehicle.ekf2_model.resets % 256,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def _vfr_hud(view: VehicleView) -> Fields:
    north, east, down = view.velocity
    return (
        0.0,
        math.hypot(north, east),
        fitted(view.heading_deg, (0, 360)) % 360,
        fitted(100.0 * view.vehicle.attitude_setpoint[2], (0, 100)),
        view.origin.altitude_m + view.height,
        -down,
    )


def _home_position(view: VehicleView) -> Fields:
    if not view.known.local_position:
        return None
    home = view.vehicle.home
    place, local = globe_fields(view.origin.global_of(home)), ned_from_enu(home).tolist()
    unknown = [1.0, 0.0, 0.0, 0.0], _NAN, _NAN, _NAN
    return (*place, *local, *unknown, view.boot_us)


def _attitude_target(view: VehicleView) -> Fields:
    attitude, rates, thrust = view.vehicle.attitude_setpoint
    q, turn = px4_quaternion(attitude).tolist(), frd_from_flu(rates).tolist()
    return (view.boot_ms, 0, q, *turn, thrust)


def _estimator_status(view: VehicleView) -> Fields:
    known = view.known
    flags = mavlink.ESTIMATOR_ATTITUDE if known.attitude else 0
    if known.local_position:
        flags |= (
            mavlink.ESTIMATOR_VELOCITY_HORIZ
            | mavlink.ESTIMATOR_VELOCITY_VERT
            | mavlink.ESTIMATOR_POS_HORIZ_REL
            | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
            | mavlink.ESTIMATOR_POS_VERT_ABS
        )
    if not known.local_position or view.vehicle.landed == MavLandedState.ON_GROUND:
        flags |= mavlink.ESTIMATOR_CONST_POS_MODE  # PX4 sets it at rest as well
    if known.global_position:
        flags |= mavlink.ESTIMATOR_POS_HORIZ_ABS | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
    deviation = math.sqrt(view.vehicle.ekf2_model.variances(view.vehicle.tick)[0])
    fused = 0.0 if known.local_position else _NAN  # no source, no ratio
    ratios = (_NAN, fused, fused, _NAN, _NAN, _NAN)
    return (view.boot_us, flags, *ratios, math.sqrt(2.0) * deviation, deviation)


def _highres_imu(view: VehicleView) -> Fields:
    """Return HIGHRES_IMU: the IMU sample of the tick; field and air without noise."""
    measured = view.vehicle.simulator.imu
    state = view.vehicle.simulator.plant.state
    height = view.origin.altitude_m + float(state.position[2])
    return (
        view.boot_us,
        *frd_from_flu(measured[3:]).tolist(),
        *frd_from_flu(measured[:3]).tolist(),
        *frd_from_flu(rotate_vector(conjugate(state.attitude), _EARTH_FIELD)).tolist(),
        0.01 * pressure_at(height),
        0.0,
        height,
        _GROUND_TEMPERATURE_C,
        _FIELDS,
    )


def _gps_raw(view: VehicleView) -> Fields:
    """Return GPS_RAW_INT, if there is a receiver."""
    if not view.vehicle.parameters.get("SYS_HAS_GPS"):
        return None
    state = view.vehicle.simulator.plant.state
    north, east, _ = ned_from_enu(state.velocity).tolist()
    return (
        view.boot_us,
        mavlink.GPS_FIX_TYPE_RTK_FIXED,
        *globe_fields(view.origin.global_of(state.position)),
        _EPH,
        _EPH,
        fitted(100.0 * math.hypot(north, east), (0, 65534), 65535),
        heading(math.degrees(math.atan2(east, north)) % 360.0),
        _SATELLITES,
    )


def _autopilot_version(view: VehicleView) -> Fields:
    uid = list(_UID.to_bytes(18, "big"))
    versions = (_VERSION, _VERSION, 0, 0, _CUSTOM, _CUSTOM, 8 * [0], 0, 0, _UID, uid)
    return (_CAPABILITIES, *versions)


class Stream(NamedTuple):
    """A message that the vehicle sends.

    Attributes:
        name: of the message.
        onboard_hz: rate on the link of an on-board computer, 0: on request alone. As measured
            on PX4 1.17 (SITL).
        ground_hz: the same of a ground station.
        build: returns its fields, or None for a value that is not known.
    """

    name: str
    onboard_hz: float
    ground_hz: float
    build: Callable[[VehicleView], Fields]

    def message(self, view: VehicleView) -> Any | None:
        """Return the message; None: it has no value."""
        fields = self.build(view)
        kind = getattr(mavlink, f"MAVLink_{self.name.lower()}_message")
        return None if fields is None else kind(*fields)


STREAMS = {
    getattr(mavlink, f"MAVLINK_MSG_ID_{stream.name}"): stream
    for stream in (
        Stream("HEARTBEAT", 1.0, 1.0, _heartbeat),
        Stream("ATTITUDE", 100.0, 20.0, lambda v: (v.boot_ms, *v.angles, *v.rates)),
        Stream("ATTITUDE_QUATERNION", 50.0, 10.0, lambda v: (v.boot_ms, *v.attitude, *v.rates)),
        Stream("HIGHRES_IMU", 50.0, 0.0, _highres_imu),
        Stream("LOCAL_POSITION_NED", 30.0, 10.0, _local_position),
        Stream("ODOMETRY", 30.0, 0.0, _odometry),
        Stream("GLOBAL_POSITION_INT", 50.0, 5.0, _global_position),
        Stream("ATTITUDE_TARGET", 10.0, 2.0, _attitude_target),
        Stream("VFR_HUD", 10.0, 4.0, _vfr_hud),
        Stream("SYS_STATUS", 5.0, 1.0, _system_status),
        Stream("EXTENDED_SYS_STATE", 5.0, 1.0, lambda v: (_NO_VTOL, int(v.vehicle.landed))),
        Stream("GPS_RAW_INT", 5.0, 1.0, _gps_raw),
        Stream("ESTIMATOR_STATUS", 1.0, 0.5, _estimator_status),
        Stream("HOME_POSITION", 0.4, 0.5, _home_position),
        Stream("BATTERY_STATUS", 0.4, 0.5, _battery_status),
        Stream("AUTOPILOT_VERSION", 0.0, 0.0, _autopilot_version),
    )
}
"""By the number of the message."""

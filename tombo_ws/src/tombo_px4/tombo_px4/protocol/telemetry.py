"""Telemetry messages of the vehicle, each stamped with its tick, in NED and FRD.

Also who the vehicle is (a PX4 1.17 quadrotor), and numbers scaled into MAVLink's integer fields.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, rotate_vector
from tombo_px4 import modes
from tombo_px4.frames import (
    UPPER_DIAGONAL,
    GeoOrigin,
    enu_from_ned,
    euler,
    frd_from_flu,
    ned_from_enu,
    px4_quaternion,
)
from tombo_px4.link.decoded_messages import MavLandedState

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


Vector = list[float]


class TelemetrySnapshot:
    """A view of the vehicle, valid for the tick it was taken at."""

    def __init__(self, vehicle: Px4Vehicle, origin: GeoOrigin) -> None:
        self.vehicle = vehicle
        self.origin = origin
        self.boot_us = vehicle.boot_us
        self.boot_ms = self.boot_us // 1000 % 2**32
        self.load = 0.0
        """As in `Telemetry`."""

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


def numbers(values: Array) -> Vector:
    """Return plain numbers, which MAVLink's encoder takes faster."""
    plain: Vector = values.tolist()
    return plain


Builder = Callable[[Any, TelemetrySnapshot], Any]
_NAN = math.nan
_STABILIZE = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_AUTO = mavlink.MAV_MODE_FLAG_AUTO_ENABLED
_GUIDED = mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
_MANUAL = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
_FLAGS = {
    modes.MANUAL.main: _MANUAL | _STABILIZE,
    modes.ALTCTL.main: _MANUAL | _STABILIZE,
    modes.POSCTL.main: _MANUAL | _STABILIZE,
    modes.AUTO_HOLD.main: _AUTO | _STABILIZE | _GUIDED,
    modes.ACRO.main: _MANUAL,
    modes.OFFBOARD.main: _STABILIZE,
    modes.STABILIZED.main: _MANUAL | _STABILIZE,
}
_EARTH_FIELD = enu_from_ned((0.21, 0.01, 0.43))
"""ENU [gauss], Zurich."""
_GROUND_TEMPERATURE_C = 25.0
_FIELDS = 0x3F | 0x1C0 | 0x200 | 0x800 | 0x1000
"""HIGHRES_IMU carries accelerometer, gyro, magnetometer, pressure, its altitude, temperature."""
_SATELLITES = 16
_EPH = 25
"""Dilution of precision, 1e-2."""
_CELLS_UNUSED = 65535


class Telemetry:
    """Builds messages about one vehicle."""

    def __init__(self, vehicle: Px4Vehicle, origin: GeoOrigin) -> None:
        self._vehicle = vehicle
        self._origin = origin
        self._snapshot = TelemetrySnapshot(vehicle, origin)
        self._tick = -1
        self.load = 0.0
        """Share of the time that the simulation needs, for SYS_STATUS."""
        self.offered = {number: name for number, (name, _) in _BUILDERS.items()}
        """Number and name of every message that can be built."""

    def message(self, number: int, mav: Any) -> Any | None:
        """Return a message about the present tick.

        None: there is no such message, or no value: an unknown position is not sent.
        """
        builder = _BUILDERS.get(number)
        if builder is None:
            return None
        if self._tick != self._vehicle.tick:
            self._tick = self._vehicle.tick
            self._snapshot = TelemetrySnapshot(self._vehicle, self._origin)
        self._snapshot.load = self.load
        return builder[1](mav, self._snapshot)

    def reset(self) -> None:
        """Drop the snapshot: a command has changed the vehicle within the tick."""
        self._tick = -1


def base_mode(vehicle: Px4Vehicle) -> int:
    """Return HEARTBEAT.base_mode as PX4 makes it."""
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if vehicle.mode != modes.OFFBOARD or vehicle.controls_attitude:
        flags |= _FLAGS.get(vehicle.mode.main, 0)
    return int(flags | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if vehicle.armed else 0))


def system_state(vehicle: Px4Vehicle) -> int:
    """Return HEARTBEAT.system_status."""
    if not vehicle.armed:
        armable = vehicle.health.armable
        return int(mavlink.MAV_STATE_STANDBY if armable else mavlink.MAV_STATE_UNINIT)
    return int(mavlink.MAV_STATE_CRITICAL if vehicle.failsafe else mavlink.MAV_STATE_ACTIVE)


def _system_status(mav: Any, p: TelemetrySnapshot) -> Any:
    """Return SYS_STATUS."""
    present, healthy = _sensors(p.vehicle, p.health)
    battery = p.vehicle.battery
    return mav.sys_status_encode(
        present,
        present,
        healthy,
        fitted(1000.0 * p.load, (0, 1000)),
        fitted(1e3 * battery.voltage, (0, 65534), 65535),
        fitted(100.0 * battery.current, (0, 32767), -1),
        fitted(100.0 * battery.remaining, (0, 100), -1),
        *(6 * [0]),
    )


def _sensors(vehicle: Px4Vehicle, health: ArmingHealth) -> tuple[int, int]:
    """Return the bits of the sensors that are present, and of those that are healthy."""
    get = vehicle.parameters.get
    sensors = {
        mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO: True,
        mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL: True,
        mavlink.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL: True,
        mavlink.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION: health.attitude,
        mavlink.MAV_SYS_STATUS_SENSOR_YAW_POSITION: health.attitude,
        mavlink.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL: health.local_position,
        mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL: health.local_position,
        mavlink.MAV_SYS_STATUS_AHRS: health.attitude,
        mavlink.MAV_SYS_STATUS_SENSOR_BATTERY: vehicle.battery.warning < 2,
        mavlink.MAV_SYS_STATUS_PREARM_CHECK: health.armable,
        mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS: True,
    }
    if get("SYS_HAS_MAG"):
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG] = True
    if get("SYS_HAS_BARO"):
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE] = True
    if get("SYS_HAS_GPS"):
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_GPS] = health.global_position
    if vehicle.ekf2_model.source == "vision":
        sensors[mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION] = health.local_position
    present = sum(sensors)
    return present, sum(bit for bit, is_healthy in sensors.items() if is_healthy)


def _heartbeat(mav: Any, p: TelemetrySnapshot) -> Any:
    v = p.vehicle
    return mav.heartbeat_encode(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        base_mode(v),
        modes.custom_mode(v.mode),
        system_state(v),
    )


def _attitude(mav: Any, p: TelemetrySnapshot) -> Any:
    return mav.attitude_encode(p.boot_ms, *p.angles, *p.rates)


def _attitude_quaternion(mav: Any, p: TelemetrySnapshot) -> Any:
    return mav.attitude_quaternion_encode(p.boot_ms, *p.attitude, *p.rates)


def _local_position(mav: Any, p: TelemetrySnapshot) -> Any:
    if not p.health.local_position:
        return None
    return mav.local_position_ned_encode(p.boot_ms, *p.position, *p.velocity)


def _global_position(mav: Any, p: TelemetrySnapshot) -> Any:
    if not p.health.global_position:
        return None
    return mav.global_position_int_encode(
        p.boot_ms,
        *globe_fields(p.globe),
        millimetres(p.height_above_home),
        *(centi(v) for v in p.velocity),
        heading(p.heading_deg),
    )


def _odometry(mav: Any, p: TelemetrySnapshot) -> Any:
    if not p.health.local_position:
        return None
    return mav.odometry_encode(
        p.boot_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,  # EKF2 gives the velocity in the axes of the position
        *p.position,
        p.attitude,
        *p.velocity,
        *p.rates,
        *(_diagonal(variances) for variances in p.variances),
        p.vehicle.ekf2_model.resets % 256,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def _diagonal(variances: Sequence[float]) -> list[float]:
    """Return the upper triangle of a covariance; PX4 does not tell the correlations."""
    upper = 21 * [_NAN]
    for place, variance in zip(UPPER_DIAGONAL, variances, strict=True):
        upper[place] = variance
    return upper


def _vfr_hud(mav: Any, p: TelemetrySnapshot) -> Any:
    north, east, down = p.velocity
    return mav.vfr_hud_encode(
        0.0,
        math.hypot(north, east),
        fitted(p.heading_deg, (0, 360)) % 360,
        fitted(100.0 * p.vehicle.thrust, (0, 100)),
        p.origin.altitude_m + p.height,
        -down,
    )


def _extended_state(mav: Any, p: TelemetrySnapshot) -> Any:
    return mav.extended_sys_state_encode(mavlink.MAV_VTOL_STATE_UNDEFINED, int(p.vehicle.landed))


def _battery_status(mav: Any, p: TelemetrySnapshot) -> Any:
    battery = p.vehicle.battery
    cells = 3
    cell = fitted(1e3 * battery.voltage / cells, (0, 65534), _CELLS_UNUSED)
    state = mavlink.MAV_BATTERY_CHARGE_STATE_OK + battery.warning  # low, critical, emergency
    return mav.battery_status_encode(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        cells * [cell] + (10 - cells) * [_CELLS_UNUSED],
        fitted(100.0 * battery.current, (0, 32767), -1),
        -1,
        -1,
        fitted(100.0 * battery.remaining, (0, 100), -1),
        0,
        state,
    )


def _home_position(mav: Any, p: TelemetrySnapshot) -> Any:
    if not p.health.local_position:
        return None
    home = p.vehicle.home
    place = globe_fields(p.origin.global_of(home))
    local = numbers(ned_from_enu(home))
    unknown = [1.0, 0.0, 0.0, 0.0], _NAN, _NAN, _NAN
    return mav.home_position_encode(*place, *local, *unknown, p.boot_us)


def _attitude_target(mav: Any, p: TelemetrySnapshot) -> Any:
    attitude, rates, thrust = p.vehicle.attitude_setpoint
    return mav.attitude_target_encode(
        p.boot_ms, 0, px4_quaternion(attitude).tolist(), *frd_from_flu(rates).tolist(), thrust
    )


def _estimator_status(mav: Any, p: TelemetrySnapshot) -> Any:
    health = p.health
    flags = mavlink.ESTIMATOR_ATTITUDE if health.attitude else 0
    if health.local_position:
        flags |= (
            mavlink.ESTIMATOR_VELOCITY_HORIZ
            | mavlink.ESTIMATOR_VELOCITY_VERT
            | mavlink.ESTIMATOR_POS_HORIZ_REL
            | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
            | mavlink.ESTIMATOR_POS_VERT_ABS
        )
    if not health.local_position or p.vehicle.landed == MavLandedState.ON_GROUND:
        flags |= mavlink.ESTIMATOR_CONST_POS_MODE  # PX4 sets it at rest as well
    if health.global_position:
        flags |= mavlink.ESTIMATOR_POS_HORIZ_ABS | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
    variance, _ = p.variances
    accuracy = (math.sqrt(variance[0] + variance[1]), math.sqrt(variance[2]))
    fused = 0.0 if health.local_position else _NAN  # no source, no ratio
    ratios = (_NAN, fused, fused, _NAN, _NAN, _NAN)
    return mav.estimator_status_encode(p.boot_us, flags, *ratios, *accuracy)


def _highres_imu(mav: Any, p: TelemetrySnapshot) -> Any:
    """Return HIGHRES_IMU: the IMU sample of the tick; field and air without noise."""
    measured = p.vehicle.simulator.imu
    state = p.vehicle.simulator.plant.state
    height = p.origin.altitude_m + float(state.position[2])
    return mav.highres_imu_encode(
        p.boot_us,
        *numbers(frd_from_flu(measured[3:])),
        *numbers(frd_from_flu(measured[:3])),
        *numbers(frd_from_flu(rotate_vector(conjugate(state.attitude), _EARTH_FIELD))),
        0.01 * pressure_at(height),
        0.0,
        height,
        _GROUND_TEMPERATURE_C,
        _FIELDS,
    )


def _gps_raw(mav: Any, p: TelemetrySnapshot) -> Any:
    """Return GPS_RAW_INT, if there is a receiver."""
    if not p.vehicle.parameters.get("SYS_HAS_GPS"):
        return None
    state = p.vehicle.simulator.plant.state
    north, east, _ = numbers(ned_from_enu(state.velocity))
    speed = math.hypot(north, east)
    course = math.degrees(math.atan2(east, north)) % 360.0
    return mav.gps_raw_int_encode(
        p.boot_us,
        mavlink.GPS_FIX_TYPE_RTK_FIXED,
        *globe_fields(p.origin.global_of(state.position)),
        _EPH,
        _EPH,
        fitted(100.0 * speed, (0, 65534), 65535),
        heading(course),
        _SATELLITES,
    )


_BUILDERS: dict[int, tuple[str, Builder]] = {
    0: ("HEARTBEAT", _heartbeat),
    1: ("SYS_STATUS", _system_status),
    24: ("GPS_RAW_INT", _gps_raw),
    30: ("ATTITUDE", _attitude),
    31: ("ATTITUDE_QUATERNION", _attitude_quaternion),
    32: ("LOCAL_POSITION_NED", _local_position),
    33: ("GLOBAL_POSITION_INT", _global_position),
    74: ("VFR_HUD", _vfr_hud),
    83: ("ATTITUDE_TARGET", _attitude_target),
    105: ("HIGHRES_IMU", _highres_imu),
    147: ("BATTERY_STATUS", _battery_status),
    148: ("AUTOPILOT_VERSION", lambda mav, p: autopilot_version(mav)),
    230: ("ESTIMATOR_STATUS", _estimator_status),
    242: ("HOME_POSITION", _home_position),
    245: ("EXTENDED_SYS_STATE", _extended_state),
    331: ("ODOMETRY", _odometry),
}

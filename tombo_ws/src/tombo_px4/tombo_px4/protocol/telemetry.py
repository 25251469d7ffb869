"""Telemetry messages of the vehicle, each stamped with its tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.rotation import conjugate, rotate_vector
from tombo_px4 import modes
from tombo_px4.frames import (
    UPPER_DIAGONAL,
    GeoOrigin,
    enu_from_ned,
    frd_from_flu,
    ned_from_enu,
    px4_quaternion,
    px4_yaw,
    px4_yaw_rate,
)
from tombo_px4.link.decoded_messages import MavLandedState
from tombo_px4.protocol.telemetry_snapshot import (
    TelemetrySnapshot,
    autopilot_version,
    centi,
    fitted,
    globe_fields,
    ground_truth,
    heading,
    millimetres,
    numbers,
    pressure_at,
    protocol_version,
)

if TYPE_CHECKING:
    from tombo_px4.autopilot.vehicle import Px4Vehicle
    from tombo_px4.autopilot.vehicle_state import ArmingHealth

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
_NO_AXIS = 0b110111111111
"""POSITION_TARGET_LOCAL_NED.type_mask of a set point without any axis."""


class Telemetry:
    """Builds messages about one vehicle."""

    def __init__(self, vehicle: Px4Vehicle, origin: GeoOrigin) -> None:
        self._vehicle = vehicle
        self._origin = origin
        self._snapshot = TelemetrySnapshot(vehicle, origin)
        self._tick = -1
        self.load = 0.0
        """Share of the time that the simulation needs, for SYS_STATUS."""
        self.unix_us = 0
        """Time of day, for SYSTEM_TIME; 0: not known."""
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
        self._snapshot.load, self._snapshot.unix_us = self.load, self.unix_us
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


def _altitude(mav: Any, p: TelemetrySnapshot) -> Any:
    if not p.health.local_position:
        return None
    amsl = p.origin.altitude_m + p.height
    return mav.altitude_encode(p.boot_us, amsl, amsl, p.height, p.height_above_home, _NAN, _NAN)


def _vfr_hud(mav: Any, p: TelemetrySnapshot) -> Any:
    north, east, down = p.velocity
    shares = p.normalized_rotor_speeds
    throttle = sum(shares) / len(shares) if p.vehicle.armed else 0.0
    return mav.vfr_hud_encode(
        0.0,
        math.hypot(north, east),
        fitted(p.heading_deg, (0, 360)) % 360,
        fitted(100.0 * throttle, (0, 100)),
        p.origin.altitude_m + p.height,
        -down,
    )


def _servo_output(mav: Any, p: TelemetrySnapshot) -> Any:
    shares = p.normalized_rotor_speeds
    pulses = [fitted(1000.0 + 1000.0 * share, (1000, 2000)) for share in shares]
    if not p.vehicle.armed:
        pulses = 4 * [900]
    return mav.servo_output_raw_encode(p.boot_us % 2**32, 0, *pulses, 0, 0, 0, 0)


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
    if not p.health.home:
        return None
    home = p.vehicle.home
    place = globe_fields(p.origin.global_of(home))
    local = numbers(ned_from_enu(home))
    unknown = [1.0, 0.0, 0.0, 0.0], _NAN, _NAN, _NAN
    return mav.home_position_encode(*place, *local, *unknown, p.boot_us)


def _origin_message(mav: Any, p: TelemetrySnapshot) -> Any:
    if not p.health.global_position:
        return None
    place = globe_fields(p.origin.global_of((0.0, 0.0, 0.0)))
    return mav.gps_global_origin_encode(*place, p.boot_us)


def _attitude_target(mav: Any, p: TelemetrySnapshot) -> Any:
    attitude, rates, thrust = p.vehicle.attitude_setpoint
    return mav.attitude_target_encode(
        p.boot_ms, 0, px4_quaternion(attitude).tolist(), *frd_from_flu(rates).tolist(), thrust
    )


def _position_target(mav: Any, p: TelemetrySnapshot) -> Any:
    wanted = p.vehicle.position_setpoint
    frame = mavlink.MAV_FRAME_LOCAL_NED
    if wanted is None and not p.vehicle.armed:  # PX4 goes on, with nothing in it
        nothing = 11 * [math.nan]
        return mav.position_target_local_ned_encode(p.boot_ms, frame, _NO_AXIS, *nothing)
    if wanted is None:
        return None
    vectors = (wanted.position, wanted.velocity, wanted.acceleration)
    axes = [
        *(v for vector in vectors for v in numbers(ned_from_enu(vector))),
        math.nan if math.isnan(wanted.yaw) else px4_yaw(wanted.yaw),
        px4_yaw_rate(wanted.yaw_rate),
    ]
    bits = (*range(9), 10, 11)
    mask = sum(1 << bit for bit, v in zip(bits, axes, strict=True) if math.isnan(v))
    return mav.position_target_local_ned_encode(p.boot_ms, frame, mask, *axes)


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
    gyro, force = p.imu[:3], p.imu[3:]
    state = p.vehicle.simulator.plant.state
    height = p.origin.altitude_m + float(state.position[2])
    return mav.highres_imu_encode(
        p.boot_us,
        *force,
        *gyro,
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


def _ground_truth(mav: Any, p: TelemetrySnapshot) -> Any:
    return ground_truth(mav, p.boot_us, p.origin, p.vehicle.simulator.plant)


_BUILDERS: dict[int, tuple[str, Builder]] = {
    0: ("HEARTBEAT", _heartbeat),
    1: ("SYS_STATUS", _system_status),
    2: ("SYSTEM_TIME", lambda mav, p: mav.system_time_encode(p.unix_us, p.boot_ms)),
    24: ("GPS_RAW_INT", _gps_raw),
    30: ("ATTITUDE", _attitude),
    31: ("ATTITUDE_QUATERNION", _attitude_quaternion),
    32: ("LOCAL_POSITION_NED", _local_position),
    33: ("GLOBAL_POSITION_INT", _global_position),
    36: ("SERVO_OUTPUT_RAW", _servo_output),
    49: ("GPS_GLOBAL_ORIGIN", _origin_message),
    74: ("VFR_HUD", _vfr_hud),
    83: ("ATTITUDE_TARGET", _attitude_target),
    85: ("POSITION_TARGET_LOCAL_NED", _position_target),
    105: ("HIGHRES_IMU", _highres_imu),
    115: ("HIL_STATE_QUATERNION", _ground_truth),
    141: ("ALTITUDE", _altitude),
    147: ("BATTERY_STATUS", _battery_status),
    148: ("AUTOPILOT_VERSION", lambda mav, p: autopilot_version(mav)),
    230: ("ESTIMATOR_STATUS", _estimator_status),
    241: ("VIBRATION", lambda mav, p: mav.vibration_encode(p.boot_us, 0.0, 0.0, 0.0, 0, 0, 0)),
    242: ("HOME_POSITION", _home_position),
    245: ("EXTENDED_SYS_STATE", _extended_state),
    300: ("PROTOCOL_VERSION", lambda mav, p: protocol_version()),
    331: ("ODOMETRY", _odometry),
}

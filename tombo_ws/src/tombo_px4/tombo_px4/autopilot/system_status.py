"""HEARTBEAT's flags and SYS_STATUS: mode, state, sensors, battery."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.bridge import modes
from tombo_px4.protocol.field_scaling import fitted

if TYPE_CHECKING:
    from tombo_px4.autopilot.vehicle import Px4Vehicle
    from tombo_px4.protocol.results import Health
    from tombo_px4.protocol.telemetry_snapshot import TelemetrySnapshot

_STABILIZE = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_AUTO = mavlink.MAV_MODE_FLAG_AUTO_ENABLED
_GUIDED = mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
_MANUAL = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
_FLAGS = {
    modes.MANUAL.main: _MANUAL,
    modes.ALTCTL.main: _MANUAL | _STABILIZE,
    modes.POSCTL.main: _MANUAL | _STABILIZE | _GUIDED,
    modes.AUTO_HOLD.main: _AUTO | _STABILIZE | _GUIDED,
    modes.ACRO.main: _MANUAL,
    modes.OFFBOARD.main: _AUTO | _STABILIZE | _GUIDED,
    modes.STABILIZED.main: _MANUAL | _STABILIZE,
}


def base_mode(vehicle: Px4Vehicle) -> int:
    """Return HEARTBEAT.base_mode as PX4 makes it."""
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | _FLAGS.get(vehicle.mode.main, 0)
    return int(flags | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if vehicle.armed else 0))


def system_state(vehicle: Px4Vehicle) -> int:
    """Return HEARTBEAT.system_status."""
    if vehicle.failsafe and vehicle.armed:
        return int(mavlink.MAV_STATE_CRITICAL)
    if vehicle.armed:
        return int(mavlink.MAV_STATE_ACTIVE)
    return int(mavlink.MAV_STATE_STANDBY)


def system_status(mav: Any, p: TelemetrySnapshot) -> Any:
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


def _sensors(vehicle: Px4Vehicle, health: Health) -> tuple[int, int]:
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
    return present, sum(bit for bit, well in sensors.items() if well)

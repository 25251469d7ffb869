"""The sensors of the simulated flight controller, in PX4's frames and units, with seeded noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import Plant
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.frames import GeoOrigin, enu_from_ned, frd_from_flu, ned_from_enu, px4_quaternion
from tombo_px4.hil.params import HilParams
from tombo_px4.protocol.field_scaling import fitted, globe_fields

_STREAM = 4560
"""Key of the random generator: whatever else a seed decides stays as it is without this link."""
_SEA_LEVEL_PA, _SEA_LEVEL_K, _LAPSE_K_M, _EXPONENT = 101_325.0, 288.15, 0.0065, 5.25588
_SEA_LEVEL_KG_M3 = 1.225
"""International standard atmosphere, up to 11 km."""
_FULL_SCALE = np.array([[16.0 * GRAVITY], [math.radians(2000.0)]]) * (1.0 - 2.0**-16)
"""PX4 keeps accelerometer and gyro in 16 bits, and beyond them the sign turns round. Here both
reach into the last step, which PX4 takes for clipped."""
_INT16 = (-32_768, 32_767)
"""A strike's force is more than that."""
_FIX_3D, _SATELLITES = 3, 14
_EPH_CM, _EPV_CM = 70, 110
_SLOW = 0.1
"""[m/s] below this a course over ground means nothing."""


def pressure_at(altitude: float) -> float:
    """Return the pressure [Pa] of the standard atmosphere at an altitude [m]."""
    return float(_SEA_LEVEL_PA * (1.0 - _LAPSE_K_M * altitude / _SEA_LEVEL_K) ** _EXPONENT)


def altitude_at(pressure: float) -> float:
    """Return the altitude [m] of a pressure [Pa] in the standard atmosphere."""
    cooler = 1.0 - (pressure / _SEA_LEVEL_PA) ** (1.0 / _EXPONENT)
    return float(cooler * _SEA_LEVEL_K / _LAPSE_K_M)


class HilSensors:
    """Reads the plant. `observe` in every tick; the others when a message is due."""

    def __init__(self, params: HilParams, seed: int) -> None:
        self._p = params
        self._rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
        self.origin = GeoOrigin(params.latitude, params.longitude, params.altitude)
        down, east = math.radians(params.inclination), math.radians(params.declination)
        level = math.cos(down)
        direction = (level * math.cos(east), level * math.sin(east), math.sin(down))
        self._field = params.field_strength * enu_from_ned(direction)
        self._spread = np.array([[params.accel_noise], [params.gyro_noise]])
        self._sum = np.zeros(6)
        self._ticks = 0

    def observe(self, imu: Array) -> None:
        """Add the tick's gyro and accelerometer, as `Simulator.imu`."""
        self._sum += imu
        self._ticks += 1

    def inertial(self) -> list[float]:
        """Return force (3) [m/s^2] and rates (3) [rad/s], FRD: the mean since the last call.

        A strike goes beyond 16 g; it stops there, as it does in a real sensor.
        """
        mean = (self._sum / max(self._ticks, 1)).reshape(2, 3)[::-1]
        self._sum[:] = 0.0
        self._ticks = 0
        noisy = frd_from_flu(mean) + self._spread * self._rng.standard_normal((2, 3))
        values: list[float] = np.clip(noisy, -_FULL_SCALE, _FULL_SCALE).ravel().tolist()
        return values

    def slow(self, plant: Plant) -> tuple[float, ...]:
        """Return magnetometer, barometer, pitot tube and thermometer, as in HIL_SENSOR.

        Field (3) FRD [gauss], pressure [hPa], that of a pitot tube forward [hPa], altitude that
        the pressure means [m], temperature [deg C].
        """
        n = self._rng.standard_normal(4)
        body = frd_from_flu(plant.rotation.T @ self._field)
        height = self.origin.altitude_m + float(plant.state.position[2])
        pressure = pressure_at(height) + self._p.pressure_noise * float(n[3])
        forward = float(plant.airspeed[0])
        return (
            *(body + self._p.mag_noise * n[:3]).tolist(),
            0.01 * pressure,
            0.01 * 0.5 * _SEA_LEVEL_KG_M3 * forward * abs(forward),
            altitude_at(pressure),
            15.0 - _LAPSE_K_M * height,
        )

    def gps(self, mav: Any, time_us: int, plant: Plant) -> Any:
        """Return HIL_GPS, a fix with noise."""
        n = self._rng.standard_normal(6)
        position = plant.state.position + self._p.gps_position_noise * n[:3]
        velocity = ned_from_enu(plant.state.velocity + self._p.gps_velocity_noise * n[3:])
        north, east, down = velocity.tolist()
        speed = math.hypot(north, east)
        course = round(math.degrees(math.atan2(east, north)) * 100.0) % 36_000
        return mav.hil_gps_encode(
            time_us,
            _FIX_3D,
            *globe_fields(self.origin.global_of(position)),
            _EPH_CM,
            _EPV_CM,
            min(round(100.0 * speed), 65_534),
            *(fitted(100.0 * v, _INT16) for v in (north, east, down)),
            course if speed > _SLOW else 65_535,
            _SATELLITES,
        )

    def truth(self, mav: Any, time_us: int, plant: Plant) -> Any:
        """Return HIL_STATE_QUATERNION: ground truth."""
        rates, force = frd_from_flu(np.stack([plant.state.rates, plant.force]))
        to_milli_g = 1000.0 / GRAVITY / float(plant.mass)
        flow = plant.airspeed
        air_speed = min(round(100.0 * math.sqrt(float(flow @ flow))), 65_535)
        return mav.hil_state_quaternion_encode(
            time_us,
            px4_quaternion(plant.state.attitude).tolist(),
            *rates.tolist(),
            *globe_fields(self.origin.global_of(plant.state.position)),
            *(fitted(100.0 * v, _INT16) for v in ned_from_enu(plant.state.velocity).tolist()),
            air_speed,
            air_speed,
            *(fitted(to_milli_g * f, _INT16) for f in force.tolist()),
        )

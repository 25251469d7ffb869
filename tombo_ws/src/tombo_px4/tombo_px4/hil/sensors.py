"""The sensors of the simulated flight controller, in PX4's frames and units, with seeded noise."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import Plant
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.frames import GeoOrigin, enu_from_ned, frd_from_flu, ned_from_enu, px4_quaternion
from tombo_px4.hil.params import HilParams

_STREAM = 4560
"""Key of the stream of chance: whatever else a seed decides stays as it is without this link."""
_SEA_LEVEL_PA, _SEA_LEVEL_K, _LAPSE_K_M, _EXPONENT = 101_325.0, 288.15, 0.0065, 5.25588
"""International standard atmosphere, up to 11 km."""
_AIR_DENSITY = 1.225
_FULL_SCALE = np.array([[16.0 * GRAVITY], [math.radians(2000.0)]]) * (1.0 - 2.0**-16)
"""PX4 keeps accelerometer and gyro in 16 bits, and beyond them the sign turns round. Here both
reach into the last step, which PX4 takes for clipped."""
_SLOW = 0.1
"""[m/s] below this a course over ground means nothing."""


def pressure_at(altitude: float) -> float:
    """Return the pressure [Pa] of the standard atmosphere at an altitude [m]."""
    return float(_SEA_LEVEL_PA * (1.0 - _LAPSE_K_M * altitude / _SEA_LEVEL_K) ** _EXPONENT)


def altitude_at(pressure: float) -> float:
    """Return the altitude [m] of a pressure [Pa] in the standard atmosphere."""
    return float(
        (1.0 - (pressure / _SEA_LEVEL_PA) ** (1.0 / _EXPONENT)) * _SEA_LEVEL_K / _LAPSE_K_M
    )


class SlowSensors(NamedTuple):
    """What is measured at every fifth message only."""

    field: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Magnetic field, FRD [gauss]."""
    pressure: float = 0.0
    """[hPa]."""
    differential: float = 0.0
    """Of a pitot tube forward [hPa]."""
    altitude: float = 0.0
    """That the pressure means [m]."""
    temperature: float = 15.0
    """[deg C]."""


class Gps(NamedTuple):
    """A fix, in the units of HIL_GPS."""

    latitude: int
    """[1e-7 deg]."""
    longitude: int
    """[1e-7 deg]."""
    altitude: int
    """[mm]."""
    velocity: tuple[int, int, int]
    """NED [cm/s]."""
    ground_speed: int
    """[cm/s]."""
    course: int
    """Clockwise from north [cdeg]; 65535: too slow to tell."""


class GroundTruth(NamedTuple):
    """What is really so, in the units of HIL_STATE_QUATERNION."""

    attitude: tuple[float, ...]
    """wxyz, NED from FRD."""
    rates: tuple[float, ...]
    """FRD [rad/s]."""
    latitude: int
    longitude: int
    altitude: int
    """[mm]."""
    velocity: tuple[int, ...]
    """NED [cm/s]."""
    air_speed: int
    """[cm/s]."""
    force: tuple[int, ...]
    """Specific force, FRD [mG]."""


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

    def slow(self, plant: Plant) -> SlowSensors:
        """Return magnetometer, barometer, pitot tube and thermometer."""
        n = self._rng.standard_normal(4)
        body = frd_from_flu(plant.rotation.T @ self._field)
        x, y, z = (body + self._p.mag_noise * n[:3]).tolist()
        height = self.origin.altitude_m + float(plant.state.position[2])
        pressure = pressure_at(height) + self._p.pressure_noise * float(n[3])
        forward = float(plant.airspeed[0])
        return SlowSensors(
            (x, y, z),
            0.01 * pressure,
            0.01 * 0.5 * _AIR_DENSITY * forward * abs(forward),
            altitude_at(pressure),
            15.0 - _LAPSE_K_M * height,
        )

    def gps(self, plant: Plant) -> Gps:
        """Return a fix."""
        n = self._rng.standard_normal(6)
        position = plant.state.position + self._p.gps_position_noise * n[:3]
        latitude, longitude, altitude = self._place(position)
        velocity = ned_from_enu(plant.state.velocity + self._p.gps_velocity_noise * n[3:])
        north, east, down = velocity.tolist()
        speed = math.hypot(north, east)
        course = round(math.degrees(math.atan2(east, north)) * 100.0) % 36_000
        return Gps(
            latitude,
            longitude,
            altitude,
            (_short(100.0 * north), _short(100.0 * east), _short(100.0 * down)),
            min(round(100.0 * speed), 65_534),
            course if speed > _SLOW else 65_535,
        )

    def truth(self, plant: Plant) -> GroundTruth:
        """Return what is really so."""
        latitude, longitude, altitude = self._place(plant.state.position)
        body = np.stack([plant.state.rates, plant.force])
        rates, force = frd_from_flu(body)
        to_milli_g = 1000.0 / GRAVITY / float(plant.mass)
        flow = plant.airspeed
        return GroundTruth(
            tuple(px4_quaternion(plant.state.attitude).tolist()),
            tuple(rates.tolist()),
            latitude,
            longitude,
            altitude,
            tuple(_short(100.0 * v) for v in ned_from_enu(plant.state.velocity).tolist()),
            min(round(100.0 * math.sqrt(float(flow @ flow))), 65_535),
            tuple(_short(to_milli_g * f) for f in force.tolist()),
        )

    def _place(self, position: Array) -> tuple[int, int, int]:
        latitude, longitude, altitude = self.origin.global_of(position)
        return round(1e7 * latitude), round(1e7 * longitude), round(1e3 * altitude)


def _short(value: float) -> int:
    """Return the nearest number of 16 bits: a strike's force is more than that."""
    return round(min(max(value, -32_768.0), 32_767.0))

"""One flight of the Tombo vehicle with an autopilot on the other side: controls in, messages out.

No socket and no clock: `step` is one HIL_SENSOR interval; `tombo_px4.hil.lockstep` runs it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common

from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.time_base import TICK_NS
from tombo_dynamics.vehicle import GRAVITY, SPIN, VehicleParams
from tombo_px4.bridge.vehicle_parameters import SAFE_PARAMETERS
from tombo_px4.frames import PX4_ROTORS, GeoOrigin, enu_from_ned, frd_from_flu, ned_from_enu
from tombo_px4.protocol.telemetry import (
    INT16,
    altitude_at,
    fitted,
    globe_fields,
    pressure_at,
    temperature_at,
)
from tombo_sim.flight_setup import begin
from tombo_sim.simulator import Simulator
from tombo_sim.world import World

PX4_PORT = 4560
"""Of PX4 instance 0; instance N asks for this port plus N."""
SYSTEM, COMPONENT = 1, 200
"""MAVLink ids that PX4's simulators use."""
_ROUNDING = 1e-3
"""A control this much outside 0..1 is rounding."""


class MotorMapping:
    """Controls of PX4's motors 1 to 4 to speeds of our rotors.

    PX4 takes thrust for linear in control (THR_MDL_FAC 0) and starts from hovering at 0.5
    (MPC_THR_HOVER). It is linear here too, from the idle thrust at 0 to the highest at 1, as in
    jMAVSim: the default propeller (13) hovers at 0.460, the rigid one, which is stronger, at
    0.314. A roll control of 1 gives 236 rad/s^2; PX4's iris has about 200, so the gains of its
    airframe fit.
    """

    def __init__(self, vehicle: VehicleParams, maps: RotorMaps) -> None:
        self._maps = maps
        self._lowest = float(maps.thrust_lowest)
        self._range = float(maps.thrust_highest) - self._lowest
        self.hover = (vehicle.hover_thrust() - self._lowest) / self._range
        """Control in hover: what MPC_THR_HOVER should be."""

    def speeds(self, controls: Sequence[float], armed: bool) -> Array:
        """Return rotor speeds (4) [rad/s] in our order; an unarmed rotor stands still.

        A control outside [0, 1], or NaN, is taken for 0.
        """
        out = np.zeros(4)
        for rotor, value in zip(PX4_ROTORS, controls, strict=False):
            if not -_ROUNDING <= value <= 1.0 + _ROUNDING:
                value = 0.0
            if armed:
                thrust = self._lowest + min(max(value, 0.0), 1.0) * self._range
                out[rotor] = speed_for_thrust(self._maps, thrust)
        return out


_STREAM = 4560
"""Key of the random generator: whatever else a seed decides stays as it is without this link."""
_SEA_LEVEL_KG_M3 = 1.225
"""Of the standard atmosphere."""
_FULL_SCALE = np.array([[16.0 * GRAVITY], [math.radians(2000.0)]]) * (1.0 - 2.0**-16)
"""PX4 keeps accelerometer and gyro in 16 bits, and beyond them the sign turns round. Here both
reach into the last step, which PX4 takes for clipped."""
_FORCE_NOISE, _RATE_NOISE = 0.02, 0.002
"""[m/s^2], [rad/s]: standard deviations of a message, besides those of `effects.imu_noise`. PX4
calls a sensor that repeats a value a hundred times broken. Estimated, because twice the step of
PX4's own reading never stands still; the same holds for the next two."""
_FIELD_NOISE, _PRESSURE_NOISE = 0.002, 0.5
"""[gauss], [Pa]: 0.2 degrees, 4 cm of height."""
_GPS_NOISE, _GPS_SPEED_NOISE = 0.1, 0.05
"""[m], [m/s] of each axis; estimated, because that is the noise under an open sky."""
_FIELD = 0.48, math.radians(63.1), math.radians(3.3)
"""Strength [gauss], inclination (down) and declination (east) [rad] of the earth's field. From
PX4's table of the world magnetic model, at the place of PX4's SITL."""
_FIX_3D, _SATELLITES = 3, 14
_EPH_CM, _EPV_CM = 70, 110
_SLOW = 0.1
"""[m/s] below this a course over ground means nothing."""


class HilSensors:
    """Reads the plant. `observe` in every tick; the others when a message is due."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
        self.origin = GeoOrigin()
        strength, down, east = _FIELD
        level = math.cos(down)
        direction = (level * math.cos(east), level * math.sin(east), math.sin(down))
        self._field = strength * enu_from_ned(direction)
        self._spread = np.array([[_FORCE_NOISE], [_RATE_NOISE]])
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
        pressure = pressure_at(height) + _PRESSURE_NOISE * float(n[3])
        forward = float(plant.airspeed[0])
        return (
            *(body + _FIELD_NOISE * n[:3]).tolist(),
            0.01 * pressure,
            0.01 * 0.5 * _SEA_LEVEL_KG_M3 * forward * abs(forward),
            altitude_at(pressure),
            temperature_at(height),
        )

    def gps(self, mav: Any, time_us: int, plant: Plant) -> Any:
        """Return HIL_GPS, a fix with noise."""
        n = self._rng.standard_normal(6)
        position = plant.state.position + _GPS_NOISE * n[:3]
        velocity = ned_from_enu(plant.state.velocity + _GPS_SPEED_NOISE * n[3:])
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
            *(fitted(100.0 * v, INT16) for v in (north, east, down)),
            course if speed > _SLOW else 65_535,
            _SATELLITES,
        )


INERTIAL = 0x3F
"""Accelerometer and gyro."""
ALL_SENSORS = 0x1FFF
"""Also magnetometer, barometer, differential pressure, temperature: each group complete."""
SLOW_SENSORS_EVERY = 5
"""Messages from one with all sensors to the next: 50 Hz of 250."""
_GPS_US = 100_000
"""Period of HIL_GPS, as in PX4's simulators."""
TICK_US = TICK_NS // 1000
STEP_TICKS = 4
"""Ticks between two HIL_SENSOR: PX4 expects 250 Hz (IMU_INTEG_RATE)."""
Watch = Callable[[Simulator], None]


class MotorCommands(NamedTuple):
    """Commands of PX4: the content of HIL_ACTUATOR_CONTROLS."""

    controls: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
    """Of motors 1 to 4 in PX4's order, 0 to 1, unchecked."""
    armed: bool = False
    time_us: int = 0


class HilFlight:
    """One vehicle, from the ground. The same seed gives the same random draws.

    Attributes:
        simulator: the plant, with the ground truth.
    """

    def __init__(
        self,
        world: World,
        seed: int,
        gps: bool = True,
        watch: Watch | None = None,
        hand: Watch | None = None,
    ) -> None:
        """Set the vehicle on the ground.

        `gps`: HIL_GPS is sent, too. `watch` is called at every tick after the first; `hand` before
        its samples are taken.

        Raises:
            InputError: as `Simulator`.
        """
        self._watch = watch
        self._hand = hand
        self._gps = gps
        self.simulator = Simulator(world, seed)
        self.sensors = HilSensors(seed)
        self.controls = MotorMapping(world.vehicle, self.simulator.setup.maps)
        self.steps = 0
        self._mav = common.MAVLink(None, SYSTEM, COMPONENT)
        self._slow: tuple[float, ...] = ()

    @property
    def time_us(self) -> int:
        """Time of the present tick: PX4's clock."""
        return self.simulator.tick * TICK_US

    def step(self, motors: MotorCommands) -> bytes:
        """Fly one interval with the motors as wanted; return the frames for PX4, in one piece.

        HIL_SENSOR is the last, because it moves PX4's clock and wakes it: earlier messages have
        then arrived, in every run alike, with the time of the HIL_SENSOR before.
        """
        rotors = self.controls.speeds(motors.controls, motors.armed)
        simulator, sensors = self.simulator, self.sensors
        for _ in range(STEP_TICKS):
            simulator.advance(rotors)
            if self._hand is not None:
                self._hand(simulator)
            sensors.observe(simulator.imu)
            if self._watch is not None:
                self._watch(simulator)
        self.steps += 1
        messages = []
        if self._gps and self.time_us % _GPS_US < STEP_TICKS * TICK_US:
            messages.append(sensors.gps(self._mav, self.time_us, simulator.plant))
        messages.append(self._sensor())
        return b"".join(bytes(message.pack(self._mav)) for message in messages)

    def _sensor(self) -> Any:
        fields = INERTIAL
        if (self.steps - 1) % SLOW_SENSORS_EVERY == 0:
            self._slow = self.sensors.slow(self.simulator.plant)
            fields = ALL_SENSORS
        inertial = self.sensors.inertial()
        return self._mav.hil_sensor_encode(self.time_us, *inertial, *self._slow, fields, 0)


AIRFRAME = {"PX4_SIM_MODEL": "none_iris", "PX4_SYS_AUTOSTART": "10016"}
_MOST_INSTANCES = 255


def airframe_parameters(world: World, seed: int) -> dict[str, float]:
    """Return the PX4 parameters that describe the Tombo vehicle.

    PX4's iris has its front rotors farther out than the rear ones: untold, yawing would roll.
    """
    maps = begin(world, seed).maps
    parameters = {
        "MPC_THR_HOVER": round(MotorMapping(world.vehicle, maps).hover, 3),
        **SAFE_PARAMETERS,
    }
    positions = frd_from_flu(world.vehicle.rotor_positions())
    ratio = float(maps.torque_ratio)
    for motor, rotor in enumerate(PX4_ROTORS):
        name = f"CA_ROTOR{motor}_"
        parameters[name + "PX"] = round(float(positions[rotor, 0]), 3)
        parameters[name + "PY"] = round(float(positions[rotor, 1]), 3)
        parameters[name + "KM"] = round(ratio * float(SPIN[rotor]), 3)
    return parameters


def exported(parameters: Mapping[str, float], more: Mapping[str, str] | None = None) -> str:
    """Return the shell command that puts parameters of PX4, and `more`, into its environment."""
    settings = [f"{name}={value}" for name, value in (more or {}).items()]
    settings += [f"PX4_PARAM_{name}={value:g}" for name, value in parameters.items()]
    lines = [" ".join(settings[i : i + 3]) for i in range(0, len(settings), 3)]
    return "export " + " \\\n  ".join(lines)


def start_command(port: int, parameters: Mapping[str, float]) -> str:
    """Return the shell commands that start a PX4 that was built from its sources.

    PX4 takes PX4_PARAM_... of its environment at its start, and keeps them.
    """
    number = port - PX4_PORT
    instance = f" -i {number}" if 0 < number < _MOST_INSTANCES else ""
    return f"{exported(parameters, AIRFRAME)}\n./build/px4_sitl_default/bin/px4{instance}"

"""The yardstick: one step of the same physics and cascade in plain NumPy, as one first writes it.

Newton-Euler with a quaternion under RK4, four rotors with lag and thrust map, rotor drag, the
strike's geometry, and the cascade at 50, 250 and 1000 Hz. It flies the same approach as the
compiled kernel to within a millimetre (a test holds it to that), only slower.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tombo_control.planning.leg import Leg
from tombo_control.planning.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.mounted_propeller import thrust_map_of
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import ARM_X, ARM_Y, GRAVITY, SPIN
from tombo_flight.scenario import Scenario

_UP = np.array([0.0, 0.0, 1.0])
_WEIGHT = np.array([0.0, 0.0, -GRAVITY])


def product(p: Array, q: Array) -> Array:
    """Return the quaternion product p q, xyzw."""
    vector = p[3] * q[:3] + q[3] * p[:3] + np.cross(p[:3], q[:3])
    return np.append(vector, p[3] * q[3] - p[:3] @ q[:3])


def matrix(q: Array) -> Array:
    """Return the rotation matrix (3, 3), map from body, of a quaternion xyzw."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@dataclass
class NumpyVehicle:
    """State of vehicle and cascade, and what they are made of; SI units, map ENU, body FLU."""

    scenario: Scenario
    body: Array
    """13: position, velocity, quaternion xyzw, body rates."""
    speed: Array
    """4: rotor speeds [rad/s]."""
    command: Array = field(default_factory=lambda: np.zeros(4))
    velocity_integral: Array = field(default_factory=lambda: np.zeros(3))
    previous_velocity: Array = field(default_factory=lambda: np.zeros(3))
    rate_integral: Array = field(default_factory=lambda: np.zeros(3))
    rate_filtered: Array = field(default_factory=lambda: np.zeros(3))
    attitude_setpoint: Array = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    rates_setpoint: Array = field(default_factory=lambda: np.zeros(3))
    thrust_setpoint: float = 0.0

    def __post_init__(self) -> None:
        vehicle = self.scenario.vehicle
        chart = thrust_map_of(self.scenario.propeller)
        self.knots = np.linspace(0.0, min(vehicle.rotor_speed_max, chart.omega_max), 257)
        self.thrusts = np.asarray(chart.thrust(self.knots))
        self.torques = np.asarray(chart.torque(self.knots))
        self.inertia = np.array([vehicle.inertia_xx, vehicle.inertia_yy, vehicle.inertia_zz])
        self.hubs = vehicle.rotor_positions()
        drag = self.scenario.effects.get("linear_rotor_drag", {})
        across, along = drag.get("d_xy", 0.0), drag.get("d_z", 0.0)
        self.drag = np.array([across, across, along])
        arm, ratio = vehicle.arm_length, self._torque_ratio()
        self.mixer = np.column_stack(
            [np.full(4, 0.25), 0.5 * ARM_Y / arm, -0.5 * ARM_X / arm, -0.25 * SPIN / ratio]
        )

    def _torque_ratio(self) -> float:
        hover = self.scenario.vehicle.hover_thrust()
        speed = np.interp(hover, self.thrusts, self.knots)
        return float(np.interp(speed, self.knots, self.torques)) / hover

    def slope(self, body: Array, speed: Array, target: Array) -> Array:
        """Return d(body)/dt."""
        vehicle = self.scenario.vehicle
        thrust = np.interp(speed, self.knots, self.thrusts)
        torque = np.interp(speed, self.knots, self.torques)
        turning = vehicle.rotor_inertia * (target - speed) / vehicle.motor_time_constant
        turn = matrix(body[6:10])
        rates = body[10:13]
        force = thrust.sum() * _UP - self.drag * (turn.T @ body[3:6])
        arm = vehicle.arm_length
        moment = np.array(
            [arm * ARM_Y @ thrust, -arm * ARM_X @ thrust, -SPIN @ (torque + turning)]
        )
        momentum = self.inertia * rates + vehicle.rotor_inertia * (SPIN @ speed) * _UP
        return np.concatenate(
            [
                body[3:6],
                turn @ force / vehicle.mass + _WEIGHT,
                0.5 * product(body[6:10], np.append(rates, 0.0)),
                (moment - np.cross(rates, momentum)) / self.inertia,
            ]
        )

    def gap_to_obstacle(self) -> float:
        """Return the distance between the nearest disc's rim and the obstacle [m]."""
        pole = self.scenario.obstacle
        hubs = self.body[:3] + self.hubs @ matrix(self.body[6:10]).T
        distance = np.hypot(hubs[:, 0] - pole.x, hubs[:, 1] - pole.y)
        return float(distance.min()) - pole.radius - self.scenario.vehicle.rotor_radius

    def step(self, leg: Leg, tick: int) -> None:
        """Fly one tick of 1 ms: first slope, cascade, Runge-Kutta, rotors.

        As in the kernel the command of the tick before acts on the rotors.
        """
        h = TICK_S
        target = self.command
        lag = self.scenario.vehicle.motor_time_constant
        half = target + (self.speed - target) * np.exp(-0.5 * h / lag)
        full = target + (self.speed - target) * np.exp(-h / lag)
        self.gap_to_obstacle()
        k1 = self.slope(self.body, self.speed, target)
        self.cascade(leg, tick)
        k2 = self.slope(self.body + 0.5 * h * k1, half, target)
        k3 = self.slope(self.body + 0.5 * h * k2, half, target)
        k4 = self.slope(self.body + h * k3, full, target)
        self.body = self.body + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        self.body[6:10] /= np.linalg.norm(self.body[6:10])
        self.speed = full

    def cascade(self, leg: Leg, tick: int) -> None:
        """Run the loops that are due and set the rotor speeds."""
        if tick % 20 == 0:
            self.position_loop(leg, tick * TICK_S)
        if tick % 4 == 0:
            self.attitude_loop()
        gains, vehicle = self.scenario.control, self.scenario.vehicle
        rates = self.body[10:13]
        smooth = gains.rate_cutoff * TICK_S / (1.0 + gains.rate_cutoff * TICK_S)
        change = smooth * (rates - self.rate_filtered)
        self.rate_filtered = self.rate_filtered + change
        error = self.rates_setpoint - rates
        p = np.array([gains.rate_p, gains.rate_p, gains.yaw_rate_p])
        i = np.array([gains.rate_i, gains.rate_i, gains.yaw_rate_i])
        d = np.array([gains.rate_d, gains.rate_d, 0.0])
        self.rate_integral = np.clip(
            self.rate_integral + i * error * TICK_S, -gains.rate_i_max, gains.rate_i_max
        )
        angular = p * error + self.rate_integral - d * change / TICK_S
        torque = self.inertia * angular + np.cross(rates, self.inertia * rates)
        wanted = self.mixer @ np.append(self.thrust_setpoint, torque)
        lowest = np.interp(vehicle.rotor_speed_min, self.knots, self.thrusts)
        thrust = np.clip(wanted, lowest, self.thrusts[-1])
        self.command = np.interp(thrust, self.thrusts, self.knots)

    def position_loop(self, leg: Leg, time_s: float) -> None:
        """Position P and velocity PID: attitude and collective thrust."""
        gains, vehicle = self.scenario.control, self.scenario.vehicle
        period = 20 * TICK_S
        way, speed, change = trapezoidal_profile(
            time_s - leg.begin_s, leg.end_s - leg.begin_s, leg.ramp_s
        )
        cruise = np.array(leg.velocity)
        velocity = self.body[3:6]
        wanted = cruise * speed + gains.position_p * (
            np.array(leg.start) + cruise * way - self.body[:3]
        )
        fast = np.hypot(wanted[0], wanted[1]) / gains.velocity_max_xy
        wanted[:2] /= max(fast, 1.0)
        wanted[2] = np.clip(wanted[2], -gains.velocity_max_z, gains.velocity_max_z)
        error = wanted - velocity
        measured = (velocity - self.previous_velocity) / period
        asked = (
            cruise * change
            + gains.velocity_p * error
            + self.velocity_integral
            + gains.velocity_d * (cruise * change - measured)
        )
        self.velocity_integral = np.clip(
            self.velocity_integral + gains.velocity_i * error * period,
            -gains.velocity_i_max,
            gains.velocity_i_max,
        )
        self.previous_velocity = velocity.copy()
        asked[2] = np.clip(
            asked[2] + GRAVITY, 0.3 * GRAVITY, 4.0 * self.thrusts[-1] / vehicle.mass
        )
        across = np.hypot(asked[0], asked[1])
        asked[:2] *= min(1.0, asked[2] * np.tan(gains.tilt_max) / max(across, 1e-9))
        z = asked / np.linalg.norm(asked)
        tilt = np.array([-z[1], z[0], 0.0, 1.0 + z[2]])
        yaw = np.array([0.0, 0.0, np.sin(0.5 * leg.yaw), np.cos(0.5 * leg.yaw)])
        self.attitude_setpoint = product(tilt / np.linalg.norm(tilt), yaw)
        lift = vehicle.mass * float(asked @ matrix(self.body[6:10])[:, 2])
        highest = 4.0 * self.thrusts[-1]
        self.thrust_setpoint = float(np.clip(lift, gains.thrust_min * highest, highest))

    def attitude_loop(self) -> None:
        """Attitude P, tilt first and yaw after: body rates."""
        gains = self.scenario.control
        conjugate = self.body[6:10] * np.array([-1.0, -1.0, -1.0, 1.0])
        x, y, z, w = product(conjugate, self.attitude_setpoint)
        upright = np.hypot(w, z)
        tilt = np.array([w * x - y * z, w * y + x * z]) / upright
        sine = np.linalg.norm(tilt)
        gain = 2.0 * gains.attitude_p * (np.arctan2(sine, upright) / sine if sine > 1e-9 else 1.0)
        wanted = gain * tilt
        wanted /= max(np.linalg.norm(wanted) / gains.rate_max, 1.0)
        turn = gains.yaw_p * 2.0 * np.arcsin(np.clip(np.sign(w) * z / upright, -1.0, 1.0))
        turn = np.clip(turn, -gains.yaw_rate_max, gains.yaw_rate_max)
        self.rates_setpoint = np.append(wanted, turn)


def hovering(scenario: Scenario, position: Array) -> NumpyVehicle:
    """Return a vehicle that hovers at a position (3), its rotors at the speed that this takes."""
    vehicle = scenario.vehicle
    body = np.concatenate([position, np.zeros(3), [0.0, 0.0, 0.0, 1.0], np.zeros(3)])
    new = NumpyVehicle(scenario, body, np.zeros(4))
    new.speed = np.full(4, np.interp(vehicle.hover_thrust(), new.thrusts, new.knots))
    new.command = new.speed.copy()
    return new

"""Newton and Euler: the motion of a quadrotor, integrated with the method of Runge and Kutta.

World: x east, y north, z up. Body: x forward, y left, z up. Quaternions are wxyz and turn body
vectors into the world. The state is a list of 23 numbers: position, velocity, quaternion, body
rates, rotor speeds, position and velocity of a hanging load. Plain floats: on vectors this short
arrays are ten times slower.
"""

from __future__ import annotations

from math import sqrt

from tombo_benchmarks.diagnosis.second_simulator.hidden import Hidden
from tombo_benchmarks.diagnosis.second_simulator.strangers import Stranger
from tombo_benchmarks.diagnosis.second_simulator.vehicles import GRAVITY, PLACES, SPINS, Quadrotor

Numbers = list[float]
AIR_DENSITY = 1.2041
"""kg/m^3"""
_CORD_RATE, _CORD_DAMPING = 60.0, 0.4
"""rad/s and ratio of a load that bounces on its cord."""
_LOAD = 17
"""Where the load's position begins in the state."""


class Airframe:
    """The true vehicle: its documentation, and what is hidden."""

    def __init__(self, quad: Quadrotor, hidden: Hidden, stranger: Stranger) -> None:
        h = hidden
        self.quad, self.stranger = quad, stranger
        self.mass = quad.mass * (1.0 + h["mass_error.fraction"])
        self.inertia = [
            i * (1.0 + h[f"inertia_error.{a}{a}"])
            for i, a in zip(quad.inertia, "xyz", strict=True)
        ]
        self.lag = quad.lag + h["motor_lag.extra_tau"]
        off = h["cog_offset.x"], h["cog_offset.y"]
        self.places = [(quad.arm * x - off[0], quad.arm * y - off[1]) for x, y in PLACES]
        low = 1.0 + h["thrust_coefficient_error.fraction"]
        self.gain = [low * g for g in h.rotor_gains()]
        flat = max(quad.drag[0] + h["linear_rotor_drag.d_xy"], 0.0)
        self.drag = flat, flat, max(quad.drag[1] + h["linear_rotor_drag.d_z"], 0.0)
        self.plate = 0.5 * AIR_DENSITY * max(h["quadratic_body_drag.c_area"], 0.0)
        self.ground = max(quad.ground + h["ground_effect.strength"], 0.0)
        self.flapping = h["flapping_moment.k"]
        self.lift = h["translational_lift.k"]
        self.felt: tuple[float, ...] = (0.0,) * 6
        """Specific force [m/s^2] and angular acceleration [rad/s^2] as the latest step began."""
        self._force = 0.0, 0.0, 0.0
        self._spins: Numbers = SPINS.tolist()

    def at_rest(self, place: Numbers) -> Numbers:
        """Return the state of hovering there [m]."""
        turning = [self.quad.hover_speed] * 4
        load = [place[0], place[1], place[2] - self.stranger.cord, 0.0, 0.0, 0.0]
        return [*place, 0.0, 0.0, 0.0, 1.0, *(0.0,) * 6, *turning, *load]

    def rotor_forces(self, s: Numbers, u: float, v: float) -> tuple[Numbers, Numbers]:
        """Return thrusts [N] and drag torques [N m] in an air speed (u, v) of the disc plane."""
        quad = self.quad
        lift = max(1.0 + self.lift * (u * u + v * v), 0.2)
        ratio = quad.rotor_radius / (4.0 * max(s[2] + quad.rotor_height, 0.5 * quad.rotor_radius))
        cushion = lift / (1.0 - self.ground * ratio * ratio)
        thrusts, torques = [], []
        for speed, gain in zip(s[13:17], self.gain, strict=True):
            thrust, torque = quad.thrust_and_torque(speed)
            thrusts.append(gain * cushion * thrust)
            torques.append(gain * lift * torque)
        return thrusts, torques

    def slope(self, s: Numbers, target: Numbers, wind: Numbers, time: float) -> Numbers:
        """Return the state's derivative; rotor targets [rad/s], the air's velocity [m/s]."""
        _, _, _, vx, vy, vz, qw, qx, qy, qz, p, q, r = s[:13]
        r00, r01, r02 = (
            1 - 2 * (qy * qy + qz * qz),
            2 * (qx * qy - qw * qz),
            2 * (qx * qz + qw * qy),
        )
        r10, r11, r12 = (
            2 * (qx * qy + qw * qz),
            1 - 2 * (qx * qx + qz * qz),
            2 * (qy * qz - qw * qx),
        )
        r20, r21, r22 = (
            2 * (qx * qz - qw * qy),
            2 * (qy * qz + qw * qx),
            1 - 2 * (qx * qx + qy * qy),
        )
        ax, ay, az = vx - wind[0], vy - wind[1], vz - wind[2]
        u = r00 * ax + r10 * ay + r20 * az
        v = r01 * ax + r11 * ay + r21 * az
        w = r02 * ax + r12 * ay + r22 * az
        thrusts, torques = self.rotor_forces(s, u, v)
        flat = self.plate * sqrt(u * u + v * v + w * w)
        fx, fy = -(self.drag[0] + flat) * u, -(self.drag[1] + flat) * v
        fz = sum(thrusts) - (self.drag[2] + flat) * w
        mx, my, mz = self.flapping * v, -self.flapping * u, 0.0
        spin_up, spin = [], 0.0
        spinner = self.quad.rotor_inertia
        for k in range(4):
            x, y = self.places[k]
            mx += y * thrusts[k]
            my -= x * thrusts[k]
            rise = (target[k] - s[13 + k]) / self.lag
            spin_up.append(rise)
            mz -= self._spins[k] * (torques[k] + spinner * rise)
            spin += self._spins[k] * spinner * s[13 + k]
        load_slope = [*s[20:23], 0.0, 0.0, 0.0]
        if self.stranger.name:
            push, body, twist = self.stranger.wrench(s, (u, v), (r00, r10), sum(thrusts), time)
            if self.stranger.load:
                push, load_slope = self._hang(s)
            fx += body[0] + r00 * push[0] + r10 * push[1] + r20 * push[2]
            fy += body[1] + r01 * push[0] + r11 * push[1] + r21 * push[2]
            fz += body[2] + r02 * push[0] + r12 * push[1] + r22 * push[2]
            mz += twist
        self._force = fx, fy, fz
        ix, iy, iz = self.inertia
        hx, hy, hz = ix * p, iy * q, iz * r + spin
        m = self.mass
        return [
            vx, vy, vz,
            (r00 * fx + r01 * fy + r02 * fz) / m,
            (r10 * fx + r11 * fy + r12 * fz) / m,
            (r20 * fx + r21 * fy + r22 * fz) / m - GRAVITY,
            0.5 * (-qx * p - qy * q - qz * r), 0.5 * (qw * p + qy * r - qz * q),
            0.5 * (qw * q + qz * p - qx * r), 0.5 * (qw * r + qx * q - qy * p),
            (mx - (q * hz - r * hy)) / ix, (my - (r * hx - p * hz)) / iy,
            (mz - (p * hy - q * hx)) / iz,
            *spin_up, *load_slope,
        ]  # fmt: skip

    def step(self, s: Numbers, target: Numbers, wind: Numbers, time: float, h: float) -> Numbers:
        """Return the state after h seconds: classical Runge-Kutta, quaternion normalised."""
        half = 0.5 * h
        k1 = self.slope(s, target, wind, time)
        m = self.mass
        fx, fy, fz = self._force
        self.felt = fx / m, fy / m, fz / m, k1[10], k1[11], k1[12]
        k2 = self.slope(
            [a + half * b for a, b in zip(s, k1, strict=True)], target, wind, time + half
        )
        k3 = self.slope(
            [a + half * b for a, b in zip(s, k2, strict=True)], target, wind, time + half
        )
        k4 = self.slope([a + h * b for a, b in zip(s, k3, strict=True)], target, wind, time + h)
        new = [
            a + h / 6.0 * (b + 2.0 * (c + d) + e)
            for a, b, c, d, e in zip(s, k1, k2, k3, k4, strict=True)
        ]
        norm = sqrt(new[6] ** 2 + new[7] ** 2 + new[8] ** 2 + new[9] ** 2)
        new[6:10] = [x / norm for x in new[6:10]]
        return new

    def _hang(self, s: Numbers) -> tuple[Numbers, Numbers]:
        """Return the cord's pull on the vehicle [N], world, and the load's slope."""
        load, cord = self.stranger.load, self.stranger.cord
        way = [s[_LOAD + i] - s[i] for i in range(3)]
        length = sqrt(sum(x * x for x in way))
        way = [x / length for x in way]
        pull = 0.0
        if length > cord:
            parting = sum(way[i] * (s[_LOAD + 3 + i] - s[3 + i]) for i in range(3))
            stretch = _CORD_RATE * (length - cord) + 2.0 * _CORD_DAMPING * parting
            pull = max(load * _CORD_RATE * stretch, 0.0)
        forces = [pull * x for x in way]
        down = (0.0, 0.0, GRAVITY)
        return forces, s[20:23] + [-f / load - g for f, g in zip(forces, down, strict=True)]

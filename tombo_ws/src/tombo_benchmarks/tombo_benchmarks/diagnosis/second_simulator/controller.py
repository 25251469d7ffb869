"""Geometric tracking on SE(3) with integral terms.

Lee, Leok and McClamroch 2010; Goodarzi, Lee and Lee 2013.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt, tan

import numpy as np

from tombo_benchmarks.diagnosis.second_simulator.airframe import Numbers
from tombo_benchmarks.diagnosis.second_simulator.vehicles import GRAVITY, PLACES, SPINS, Quadrotor

_K_X, _K_V, _K_I = 4.0, 3.0, 1.2
"""1/s^2, 1/s, 1/s^3"""
_MAX_TILT = 0.75
"""rad"""
_MAX_SUM_X, _MAX_SUM_R = 2.0, 0.5
"""m s, s"""


class Tracker:
    """Rotor speeds that follow a course."""

    def __init__(self, quad: Quadrotor, step: float) -> None:
        self._quad, self._step = quad, step
        pace = min(0.32 / quad.lag, 14.0)
        self._k_r = pace**2, pace**2, 9.0
        self._k_w = 1.6 * pace, 1.6 * pace, 5.0
        self._sum_x = [0.0, 0.0, 0.0]
        self._sum_r = [0.0, 0.0, 0.0]
        thrust, torque = quad.thrust_and_torque(quad.hover_speed)
        arms = quad.arm * PLACES
        mixer = np.vstack([np.ones(4), arms[:, 1], -arms[:, 0], -torque / thrust * SPINS])
        self._unmix: list[Numbers] = np.linalg.inv(mixer).tolist()

    def speeds(self, s: Numbers, rates: Numbers, goal: Numbers) -> Numbers:
        """Return commanded rotor speeds [rad/s].

        Args:
            s: the state, of which position, velocity and attitude are used.
            rates: [rad/s] as measured.
            goal: position, velocity, acceleration, yaw: 10 numbers.
        """
        wanted = []
        for i in range(3):
            off = s[i] - goal[i]
            total = self._sum_x[i] + self._step * off
            self._sum_x[i] = max(min(total, _MAX_SUM_X), -_MAX_SUM_X)
            wanted.append(
                goal[6 + i] - _K_X * off - _K_V * (s[3 + i] - goal[3 + i]) - _K_I * self._sum_x[i]
            )
        x, y = wanted[0], wanted[1]
        z = max(min(wanted[2] + GRAVITY, 1.7 * GRAVITY), 0.4 * GRAVITY)
        less = min(1.0, tan(_MAX_TILT) * z / max(hypot(x, y), 1e-9))
        x, y = less * x, less * y
        turn = _columns(s[6], s[7], s[8], s[9])
        aim = _frame(x, y, z, goal[9])
        moments = self._moments(aim, turn, rates)
        up = turn[2]
        collective = self._quad.mass * (x * up[0] + y * up[1] + z * up[2])
        return [
            self._quad.speed_for(
                row[0] * collective
                + row[1] * moments[0]
                + row[2] * moments[1]
                + row[3] * moments[2]
            )
            for row in self._unmix
        ]

    def _moments(self, aim: list[Numbers], turn: list[Numbers], rates: Numbers) -> Numbers:
        """Return the moments [N m]; both attitudes by their columns, the body's axes in map."""

        def dot(i: int, j: int) -> float:
            a, b = aim[i], turn[j]
            return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

        errors = (
            0.5 * (dot(2, 1) - dot(1, 2)), 0.5 * (dot(0, 2) - dot(2, 0)),
            0.5 * (dot(1, 0) - dot(0, 1)),
        )  # fmt: skip
        p, q, r = rates
        inertia = self._quad.inertia
        gyroscopic = (
            (inertia[2] - inertia[1]) * q * r, (inertia[0] - inertia[2]) * p * r,
            (inertia[1] - inertia[0]) * p * q,
        )  # fmt: skip
        found = []
        for i in range(3):
            total = self._sum_r[i] + self._step * errors[i]
            self._sum_r[i] = max(min(total, _MAX_SUM_R), -_MAX_SUM_R)
            turning = -self._k_r[i] * (errors[i] + 0.8 * self._sum_r[i]) - self._k_w[i] * rates[i]
            found.append(inertia[i] * turning + gyroscopic[i])
        return found


def _columns(w: float, x: float, y: float, z: float) -> list[Numbers]:
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ]


def _frame(x: float, y: float, z: float, yaw: float) -> list[Numbers]:
    """Return the columns of an attitude with its z along (x, y, z) and its nose near the yaw."""
    length = sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    c, s = cos(yaw), sin(yaw)
    left = [-z * s, z * c, x * s - y * c]
    length = sqrt(left[0] ** 2 + left[1] ** 2 + left[2] ** 2)
    left = [a / length for a in left]
    nose = [left[1] * z - left[2] * y, left[2] * x - left[0] * z, left[0] * y - left[1] * x]
    return [nose, left, [x, y, z]]

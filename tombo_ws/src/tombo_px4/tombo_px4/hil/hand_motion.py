"""A simulated hand: carries and turns the disarmed vehicle, as an operator does before a flight.

The vehicle is moved, gyro and accelerometer say what they would; poses and PX4's answers come by
the usual way. So the proof of the axes is the same as that of a real vehicle.
"""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply, rotate_vector
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import GRAVITY
from tombo_sim.simulator import Simulator

_STEP_S = 2e-3
_LIFT_S = 1.5
"""Time to lift it, and to put it down."""
_HEIGHT = 0.8
_UP = np.array([0.0, 0.0, GRAVITY])
_CARRY = ((0.22, 0.55), (0.20, 0.71), (0.15, 0.63))
"""Amplitude [m] and frequency [Hz] along x, y and z of map."""
_TURN = ((0.55, 0.37), (0.50, 0.45), (0.70, 0.31))
"""Amplitude [rad] and frequency [Hz] about x, y and z of the body."""


class HandMotion:
    """Moves the vehicle from `begin_s` on, or when asked, and leaves it where and as it stood."""

    def __init__(self, begin_s: float = math.inf, lasts_s: float = 12.0) -> None:
        self.begin_s, self._lasts_s = begin_s, lasts_s
        self.asked = False
        """It shall move the vehicle, from the next tick on."""
        self._place: Array | None = None
        self._attitude: Array = np.array([0.0, 0.0, 0.0, 1.0])

    @property
    def end_s(self) -> float:
        """When the vehicle stands again [s]."""
        return self.begin_s + self._lasts_s

    def __call__(self, simulator: Simulator) -> None:
        """Move the vehicle of a simulator at its present tick."""
        time_s = simulator.tick * TICK_S
        if self.asked:
            self.asked, self.begin_s, self._place = False, time_s, None
        if not self.begin_s <= time_s <= self.end_s:
            return
        state = simulator.plant.state
        if self._place is None:
            self._place, self._attitude = state.position.copy(), state.attitude.copy()
        before, (place, attitude), after = (
            self._pose(time_s + step * _STEP_S) for step in (-1, 0, 1)
        )
        turn = quaternion_multiply(conjugate(before[1]), after[1])
        rates = np.sign(turn[3]) * turn[:3] / _STEP_S
        accel = (after[0] - 2.0 * place + before[0]) / _STEP_S**2
        simulator.gyro[:] += rates - state.rates
        state.position, state.attitude = place, attitude
        state.velocity, state.rates = (after[0] - before[0]) / (2.0 * _STEP_S), rates
        simulator.accel[:] = rotate_vector(conjugate(attitude), accel + _UP)

    def _pose(self, time_s: float) -> tuple[Array, Array]:
        """Return position (3) and attitude (4) xyzw at a time."""
        assert self._place is not None
        since, left = time_s - self.begin_s, self.end_s - time_s
        share = _smooth(min(since, left) / _LIFT_S)
        moves = share * _smooth(min(since, left) / _LIFT_S - 0.5)
        swings = [a * math.sin(2.0 * math.pi * f * since) for a, f in _CARRY]
        place = self._place + moves * np.array(swings) + [0.0, 0.0, share * _HEIGHT]
        attitude = self._attitude
        for axis, (amplitude, frequency) in enumerate(_TURN):
            half = 0.5 * moves * amplitude * math.sin(2.0 * math.pi * frequency * since)
            turn = np.zeros(4)
            turn[axis], turn[3] = math.sin(half), math.cos(half)
            attitude = quaternion_multiply(attitude, turn)
        return place, attitude


def _smooth(share: float) -> float:
    """Return 0 to 1 with no jump of velocity and acceleration."""
    x = min(max(share, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)

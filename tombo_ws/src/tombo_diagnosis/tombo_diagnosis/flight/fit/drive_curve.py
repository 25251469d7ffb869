"""The drive curve: thrust of a rotor from its command and the supply, of healthy flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array

_TRUSTED = 0.3
"""Standard deviation of the exponents before the fit: of command about 1 or 2, of supply 0."""
_OFFSET = 0.005
"""Spread of thrust over weight between healthy flights: batteries differ in mass by a few per
cent of a quarter of the weight."""
_WINDOW_S = 0.5
"""Long against the lag of motors and the filters of an acceleration."""
_BATCH = 4
"""Windows over which slow noise is looked for."""
_LEAST = 1e-8


@dataclass(frozen=True)
class DriveCurve:
    """Thrust over weight = gain · mean of command^exponent · voltage^supply_exponent."""

    gain: float
    exponent: float
    """Of the command: 2 for a rotor speed, 1 for a command that is linear in thrust."""
    supply_exponent: float
    """Of the voltage; 0 where the drives compensate for it, or where it is not measured."""
    deviation: tuple[float, float]
    """One standard deviation of both exponents."""

    def demand(self, command: Array, voltage: Array | None) -> Array:
        """Return the logarithm of each rotor's thrust over a quarter of the weight (N, 4).

        Args:
            command: (N, 4) above 0, in the unit that the curve was fitted in.
            voltage: (N,) [V], or None.
        """
        log = np.log(self.gain) + self.exponent * np.log(command)
        if voltage is not None:
            log = log + self.supply_exponent * np.log(voltage)[:, None]
        return np.asarray(log)


@dataclass(frozen=True)
class DriveSamples:
    """What the curve is fitted to, of one flight, in the air."""

    command: Array
    """(N, 4) above 0."""
    load_factor: Array
    """(N,) thrust over weight: 1 in hover."""
    voltage: Array | None
    """(N,) [V]"""
    step: float
    """[s] between samples."""


def fit_drive_curve(flights: Sequence[DriveSamples], exponent: float) -> DriveCurve:
    """Fit gain and exponents by least squares of the logarithm of thrust over weight.

    Both sides are averaged over windows, because noise of single commands would pull the exponent
    towards 0. Each flight has a small offset of its own. The noise is what the best curve leaves,
    so expected exponents that are wrong do not pass for noise. Where flights do not vary thrust or
    supply, the exponents stay what they were before: `exponent` and 0.
    """
    with_supply = all(f.voltage is not None for f in flights)
    blocks = [_windows(f, exponent, with_supply) for f in flights]
    rows, wanted = np.vstack([r for r, _ in blocks]), np.concatenate([t for _, t in blocks])
    centre = rows.mean(axis=0)
    own = np.repeat(np.eye(len(flights)), [len(t) for _, t in blocks], axis=0)
    every = np.column_stack([np.ones(len(wanted)), rows - centre, own])
    before = np.array([0.0, exponent, 0.0, *np.zeros(len(flights))])
    error = wanted - every @ before
    loose = np.diag([0.0, 0.0, 0.0, *np.full(len(flights), _OFFSET**-2)])
    free = _solved(every, error, 1e-6, loose)[0]
    noise = _noise_per_window(error - every @ free, [len(t) for _, t in blocks])
    trusted = loose + np.diag([0.0, _TRUSTED**-2, _TRUSTED**-2, *np.zeros(len(flights))])
    change, covariance = _solved(every, error, noise, trusted)
    found = before + change
    gain = float(np.exp(found[0] - centre @ found[1:3]))
    spread = np.sqrt(np.diag(covariance))
    supply_exponent = float(found[2]) if with_supply else 0.0
    return DriveCurve(gain, float(found[1]), supply_exponent, (float(spread[1]), float(spread[2])))


def _windows(flight: DriveSamples, exponent: float, with_supply: bool) -> tuple[Array, Array]:
    """Return logarithms of command and supply (W, 2), and of thrust over weight (W,)."""
    size = max(1, round(_WINDOW_S / flight.step))
    count = max(1, len(flight.load_factor) // size)
    size = min(size, len(flight.load_factor))

    def mean(values: Array) -> Array:
        return np.asarray(values[: count * size].reshape(count, size).mean(axis=1))

    command = np.log(mean(np.mean(flight.command**exponent, axis=1))) / exponent
    supply: Array = np.zeros(count)
    if with_supply and flight.voltage is not None:
        supply = np.log(mean(flight.voltage))
    return np.column_stack([command, supply]), np.log(mean(flight.load_factor))


def _solved(rows: Array, target: Array, noise: float, prior: Array) -> tuple[Array, Array]:
    information = rows.T @ rows / noise + prior
    inverse: Array = np.asarray(np.linalg.pinv(information), np.float64)
    return inverse @ (rows.T @ target / noise), inverse


def _noise_per_window(left: Array, counts: Sequence[int]) -> float:
    """Return the variance that a window has where windows in a row are correlated.

    Means of `_BATCH` windows, times that number: what slow noise adds shows in them.
    """
    plain = float(np.sum(left**2)) / max(1, len(left) - 3)
    ends = np.cumsum(counts)
    means = [
        left[k : k + _BATCH].mean()
        for begin, end in zip(ends - counts, ends, strict=True)
        for k in range(begin, end - _BATCH + 1, _BATCH)
    ]
    slow = _BATCH * float(np.sum(np.square(means))) / max(1, len(means) - 3)
    return max(plain, slow, _LEAST)

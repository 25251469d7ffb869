"""The drive curve: thrust of a rotor from its command and the supply, of healthy flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array

_TRUSTED = 0.3
"""Standard deviation of the exponents before the fit: of command about 1 or 2, of supply 0."""


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


def fit_drive_curve(flights: Sequence[DriveSamples], exponent: float) -> DriveCurve:
    """Fit gain and exponents by least squares of the logarithm of thrust over weight.

    Cautious: what the exponents expected before the fit leave counts as noise. Where flights do
    not vary thrust or supply, the exponents stay what they were before:
    `exponent` and 0. Each flight counts as one block of correlated samples for the deviations.
    """
    with_supply = all(f.voltage is not None for f in flights)
    rows, target = [], []
    for f in flights:
        mean = np.log(np.mean(f.command**exponent, axis=1)) / exponent
        supply = np.log(f.voltage) if with_supply and f.voltage is not None else 0.0 * mean
        rows.append(np.column_stack([np.ones_like(mean), mean, supply]))
        target.append(np.log(f.load_factor))
    every, wanted = np.vstack(rows), np.concatenate(target)
    centre = every[:, 1:].mean(axis=0)
    every[:, 1:] -= centre
    prior = np.array([0.0, exponent, 0.0])
    error = wanted - every @ prior
    noise = max(float(np.var(error)), 1e-8)
    information = every.T @ every / noise * (2.0 * len(flights) / len(wanted))
    information += np.diag([0.0, _TRUSTED**-2, _TRUSTED**-2])
    score = every.T @ error / noise * (2.0 * len(flights) / len(wanted))
    change = np.linalg.solve(information, score)
    found, covariance = prior + change, np.linalg.inv(information)
    gain = float(np.exp(found[0] - centre @ found[1:]))
    spread = np.sqrt(np.diag(covariance))
    supply_exponent = float(found[2]) if with_supply else 0.0
    return DriveCurve(gain, float(found[1]), supply_exponent, (float(spread[1]), float(spread[2])))

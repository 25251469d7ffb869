"""The drive curve: thrust of a rotor from its command and the supply, of healthy flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array

_TRUSTED = 0.3
"""Standard deviation of an exponent before the fit: of the command, and of the supply about 0."""
_OFFSET = 0.005
"""Spread of thrust over weight between healthy flights: batteries differ in mass by a few per
cent of a quarter of the weight."""
_WINDOW_S = 0.5
"""Long against the lag of motors and the filters of an acceleration."""
_BATCH = 4
"""Windows over which slow noise is looked for."""
_LOAD = (0.3, 3.0)
"""Thrust over weight of a window that is taken for one."""
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
    """Airborne data of one flight to which the curve is fitted."""

    command: Array
    """(N, 4) above 0."""
    load_factor: Array
    """(N,) thrust over weight: 1 in hover."""
    voltage: Array | None
    """(N,) [V], its slow part."""
    step: float
    """[s] between samples."""
    sag: Array | None = None
    """(N,) logarithm of the voltage over its slow part; None: as `voltage`."""


def fit_drive_curve(
    flights: Sequence[DriveSamples], exponent: float, trusted: float = _TRUSTED
) -> DriveCurve:
    """Fit gain and exponents to the logarithm of thrust over weight.

    Both sides are averaged over windows. Each flight has a small offset of its own. Air that moves
    changes thrust at one command, and who holds the height changes the command at one thrust: a
    regression of one on the other bends the exponent of the command towards 0 or away from it. Its
    evidence is the band between the two. Where flights vary thrust too little for a narrow band,
    the exponent keeps its prior value.

    A battery sags within a manoeuvre: a higher command gets less of its voltage, which flattens
    the curve. A constant load does not show that, because the slow voltage has it. So the fit is
    repeated with commands times the sag to the power by which thrust follows the slow voltage,
    over that of the command: 1 for a motor on a duty cycle, 0 where the drive makes up for it.

    Args:
        flights: healthy ones.
        exponent: of the command before the fit.
        trusted: its standard deviation.
    """
    curve = _fitted(flights, exponent, trusted, 0.0)
    if all(f.voltage is None or f.sag is None for f in flights):
        return curve
    share = min(max(curve.supply_exponent / curve.exponent, 0.0), 1.0)
    return _fitted(flights, exponent, trusted, share) if share > 0.0 else curve


def _fitted(
    flights: Sequence[DriveSamples], exponent: float, trusted: float, share: float
) -> DriveCurve:
    """Fit as `fit_drive_curve`; `share` of the logarithm of the sag is a part of the command."""
    with_supply = all(f.voltage is not None for f in flights)
    blocks = [_windows(f, exponent, with_supply, share) for f in flights]
    rows, load = np.vstack([r for r, _ in blocks]), np.concatenate([t for _, t in blocks])
    command, supply = rows.T
    counts = [len(t) for _, t in blocks]
    flight_offsets = np.repeat(np.eye(len(flights)), counts, axis=0)
    measured_exponent, deviation = _command_exponent(
        command, load, np.column_stack([flight_offsets, supply]), counts
    )
    weights = np.array([(trusted / exponent) ** -2, deviation**-2])
    log = float(weights @ [np.log(exponent), np.log(measured_exponent)] / weights.sum())
    slope, slope_deviation = float(np.exp(log)), float(np.exp(log) / np.sqrt(weights.sum()))

    middle = float(supply.mean())
    every = np.column_stack([np.ones(len(load)), supply - middle, flight_offsets])
    both = np.column_stack([load - slope * command, command])
    offsets = np.diag([0.0, 0.0, *np.full(len(flights), _OFFSET**-2)])
    free, _ = _solved(every, both[:, 0], 1e-6, offsets)
    noise = _noise_per_window(both[:, 0] - every @ free, counts)
    trust = offsets + np.diag([0.0, _TRUSTED**-2, *np.zeros(len(flights))])
    values, covariance = _solved(every, both, noise, trust)
    # the compensation of the supply depends on the exponent of the command
    supply_deviation = np.hypot(np.sqrt(covariance[1, 1]), values[1, 1] * slope_deviation)
    supply_exponent = float(values[1, 0]) if with_supply else 0.0
    gain = float(np.exp(values[0, 0] - middle * supply_exponent))
    return DriveCurve(gain, slope, supply_exponent, (slope_deviation, float(supply_deviation)))


def _command_exponent(
    command: Array, load: Array, others: Array, counts: Sequence[int]
) -> tuple[float, float]:
    """Return what flights alone say of the exponent, and the deviation of its logarithm.

    `others` (W, k) are further regressors of both. The exponent is between the regression of load
    on command and the inverse of that of command on load (Frisch's bounds): their geometric mean,
    and half the logarithm of their ratio. The deviation is infinite where the two do not go
    together.
    """
    left = [y - others @ np.linalg.lstsq(others, y, rcond=None)[0] for y in (command, load)]
    (cc, cl), (_, ll) = np.array([[a @ b for b in left] for a in left]).tolist()
    if cl <= _LEAST * len(load) or cc <= 0.0 or ll <= 0.0:
        return 1.0, np.inf
    slope = float(np.sqrt(ll / cc))
    rest = left[1] - slope * left[0]
    noise = _noise_per_window(rest, counts)
    return slope, float(np.hypot(-np.log(min(cl / np.sqrt(cc * ll), 1.0)), np.sqrt(noise / ll)))


def _windows(
    flight: DriveSamples, exponent: float, with_supply: bool, share: float
) -> tuple[Array, Array]:
    """Return logarithms of command and supply (W, 2), and of thrust over weight (W,)."""
    size = max(1, round(_WINDOW_S / flight.step))
    count = max(1, len(flight.load_factor) // size)
    size = min(size, len(flight.load_factor))

    def mean(values: Array) -> Array:
        return np.asarray(values[: count * size].reshape(count, size).mean(axis=1))

    asked = flight.command
    if share > 0.0 and flight.sag is not None:
        asked = asked * np.exp(share * flight.sag)[:, None]
    command = np.log(mean(np.mean(asked**exponent, axis=1))) / exponent
    supply: Array = np.zeros(count)
    if with_supply and flight.voltage is not None:
        supply = np.log(mean(flight.voltage))
    load = np.clip(mean(flight.load_factor), *_LOAD)
    return np.column_stack([command, supply]), np.log(load)


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

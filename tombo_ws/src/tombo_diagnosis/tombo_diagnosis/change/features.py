"""Features of a flight that describe its vehicle: demand of each rotor, vibration, oscillation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Flight, Series, why_left_out
from tombo_diagnosis.flight.fit.drive_curve import DriveCurve, DriveSamples
from tombo_diagnosis.rotor_demand import MODES
from tombo_diagnosis.track_smoothing import smooth_track
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import EvenFlight, even_times, resample, turns_at, usable_turns
from tombo_logs.checks.spans import Mask, inside, interpolated, merged, runs, sample_interval

_SUPPLY_S = 5.0
"""Over which the voltage is averaged: long against manoeuvres, short against a discharge."""
_EDGE_S = 0.5
"""Time after lift-off and before touch-down."""
_SHORTEST_S = 4.0
"""Shortest stretch in the air."""
_BRIDGED_S = 1.0
"""Length of an excluded span up to which the flight stays in one part: poses that jump, a gap."""
_FASTEST_HZ = 250.0
"""Rate of the clock, at most: an hour of flight has a million rows then."""
_SHAKE_HZ = 10.0
"""Above it no loop follows: the remainder is vibration."""
_SWING_HZ = (0.35, 1.6)
"""Frequencies of pendulums of 2 m to 0.1 m."""
_FLOOR = 1e-6
_SPEED_S = 0.3
"""Time over which a velocity is taken."""
_MOVED = 0.1
"""Standard deviation of a velocity [m/s] from which on it says something."""


@dataclass(frozen=True)
class AirborneFlight(EvenFlight):
    """A flight on an even clock; rows are valid where it is steadily in the air.

    Its channels are drive, position, load_factor (thrust over weight) and velocity (ahead and to
    the left; without an attitude along map x, y). Where the log has them: pushed (acceleration,
    measured or estimated) and voltage (its slow part).
    """

    log: Flight
    drive: str
    """One of DRIVES."""

    @property
    def used_s(self) -> float:
        """Time in the air [s]."""
        return float(np.count_nonzero(self.valid)) * self.step

    @property
    def driven(self) -> Mask:
        """(N,) valid rows in which all rotors are asked to turn."""
        return np.asarray(self.valid & (self.channels["drive"] > 0.0).all(axis=1))

    def parts(self, name: str) -> list[Array]:
        """Return a channel in each span of valid rows; none of a channel that is absent."""
        if name not in self.channels:
            return []
        return [self.channels[name][begin:end] for begin, end in runs(self.valid)]


DEMAND, SHAKE, SWING, TRAIL = slice(0, 4), slice(4, 6), 6, slice(7, 9)
"""Places in `Features.vector`."""


@dataclass(frozen=True)
class Features:
    """Features of one flight, or the mean of several. NaN: its channels don't say it."""

    vector: Array
    """(9,) DEMAND: logarithm of thrust over a quarter of the weight that the healthy drive curve
    reads, of each rotor. SHAKE: logarithm of the standard deviation above 10 Hz: of the demand of
    the rotors against each other, as a share; of the acceleration [m/s^2]. SWING: logarithm of the
    horizontal acceleration from 0.35 to 1.6 Hz [m/s^2]. TRAIL: yaw part of the demand per speed
    ahead and to the left [s/m]: drag off the centre turns the vehicle one way on the way out, and
    the other way on the way back. Without an attitude ahead is map x."""
    supply: float = float("nan")
    """Mean logarithm of the voltage."""

    @property
    def demand(self) -> Array:
        """(4,) the part DEMAND."""
        return self.vector[DEMAND]


def mean_of(flights: Sequence[Features]) -> Features:
    """Return the mean of what flights say."""
    supply = float(np.mean([f.supply for f in flights]))
    return Features(np.mean([f.vector for f in flights], axis=0), supply)


def airborne(log: Flight, drives: Sequence[str] = DRIVES) -> AirborneFlight:
    """Lay a checked flight on an even clock, with the time that it is steadily in the air.

    `drives`: channels that may say what the rotors are asked for, the best first.

    Raises:
        InputError: no position, no rotor commands or speeds, or never in the air.
    """
    series = log.series
    drive = next((d for d in drives if d in series and series[d].t.size > 20), None)
    if drive is None or "position" not in series or series["position"].t.size < 20:
        why = why_left_out(log.findings, ("position", *DRIVES))
        raise InputError(
            f"flight '{log.name}': usable channels are {', '.join(series)}{why}; needed to say "
            f"what has changed: position, and one of {', '.join(DRIVES)}; or, with an airframe, "
            "thrust_setpoint and torque_setpoint"
        )
    position, command = series["position"], series[drive]
    apart = [(b, e) for b, e in merged(log.exclude) if e - b > _BRIDGED_S]
    low, high = (f(position.t[i], command.t[i]) for f, i in ((max, 0), (min, -1)))
    edges = [low, *(x for span in apart for x in span), high]
    pairs = [(b, e) for b, e in list(pairwise(edges))[::2]]
    spans = [(b + _EDGE_S, e - _EDGE_S) for b, e in pairs if e - b > _SHORTEST_S]
    if not spans:
        raise InputError(
            f"flight '{log.name}' is never in the air for {_SHORTEST_S:g} s; needed to say what "
            "has changed"
        )
    pushed = _pushed(series)
    intervals = [sample_interval(s.t) for s in (command, pushed) if s is not None]
    step = max(min(intervals), 1.0 / _FASTEST_HZ)
    t = even_times(spans[0][0], spans[-1][1] + step, 1.0 / step)
    valid = inside(t, spans)
    channels = {"drive": _at(command, t), "position": _at(position, t)}
    channels |= {"load_factor": _load_factor(series, t), "velocity": _velocity(series, t)}
    if pushed is not None:
        channels["pushed"] = resample(pushed, t)
    supply = series.get("voltage")
    if supply is not None and (supply.values > 0.0).all():
        channels["voltage"] = _slow(_at(supply, t), valid, step)
    return AirborneFlight(t, channels, valid, log, drive)


def drive_samples(flight: AirborneFlight) -> DriveSamples:
    """Return commands, load factor and voltage of the valid rows.

    Measured speeds give thrust whatever the supply: their voltage is left out.
    """
    rows, channels = flight.driven, flight.channels
    supply = sag = None
    if flight.drive != "rotor_speed" and "voltage" in channels:
        supply = channels["voltage"][rows, 0]
        sag = np.log(_at(flight.log.series["voltage"], flight.t[rows])[:, 0] / supply)
    return DriveSamples(
        channels["drive"][rows], channels["load_factor"][rows, 0], supply, flight.step, sag
    )


def _pushed(series: Mapping[str, Series]) -> Series | None:
    """Return the acceleration that is measured, or else estimated."""
    return series.get("accel") or series.get("acceleration")


def _load_factor(series: Mapping[str, Series], t: Array) -> Array:
    """Return thrust over weight (N, 1): of the accelerometer, an estimator, or the smoothed track.

    Of the latter two it is the part along the body's z; without an attitude their size.
    """
    if "accel" in series:
        return _at(series["accel"], t)[:, 2:] / GRAVITY
    estimated = series.get("acceleration")
    pushed = estimated or smooth_track(series["position"])["acceleration"]
    force = _at(pushed, t) / GRAVITY + np.array([0.0, 0.0, 1.0])
    if "attitude" in series:
        turns = turns_at(usable_turns(series["attitude"]), t)
        return np.asarray(turns.inv().apply(force)[:, 2:])
    return np.asarray(np.linalg.norm(force, axis=1, keepdims=True))


def _velocity(series: Mapping[str, Series], t: Array) -> Array:
    """Return the velocity (N, 2) over `_SPEED_S`, ahead and to the left [m/s]."""
    position, half = series["position"], 0.5 * _SPEED_S
    speed = (_at(position, t + half) - _at(position, t - half))[:, :2] / _SPEED_S
    if "attitude" not in series:
        return np.asarray(speed)
    ahead = turns_at(usable_turns(series["attitude"]), t).apply([1.0, 0.0, 0.0])[:, :2]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    left = ahead[:, ::-1] * [-1.0, 1.0]
    return np.column_stack([np.sum(ahead * speed, axis=1), np.sum(left * speed, axis=1)])


def _at(series: Series, t: Array) -> Array:
    return interpolated(t, series.t, series.values)


def _slow(voltage: Array, valid: Mask, step: float) -> Array:
    """Return the slow part of the voltage (N, 1) in each span of valid rows.

    Faster changes follow the current, through the battery's resistance: it says what the rotors
    took, not what they were given.
    """
    slow = voltage.copy()
    for begin, end in runs(valid):
        width = max(1, round(_SUPPLY_S / step))
        slow[begin:end] = uniform_filter1d(voltage[begin:end], width, axis=0, mode="reflect")
    return slow


def features(flight: AirborneFlight, curve: DriveCurve) -> Features:
    """Return a flight's features, with the drive curve of the healthy flights."""
    samples, series = drive_samples(flight), flight.log.series
    level = float(np.mean(samples.command**curve.exponent))
    asked = [
        (np.maximum(part, 1e-9) ** curve.exponent) @ MODES[1:].T / level
        for part in flight.parts("drive")
    ]
    pushed = _pushed(series)
    supply = float("nan") if samples.voltage is None else float(np.log(samples.voltage).mean())
    vector = [
        *_demand(curve, samples),
        _shake(flight, asked, series[flight.drive]),
        _shake(flight, flight.parts("pushed"), pushed),
        _swing(flight),
        *_trail(flight, curve, samples),
    ]
    return Features(np.array(vector), supply)


def _demand(curve: DriveCurve, samples: DriveSamples) -> Array:
    """Return the demand of each rotor in level flight at one height (4,).

    Thrust that manoeuvres ask for is in the load factor, too, and so drops out; means, not medians
    or means of logarithms: these depend on manoeuvres and on vibration.
    """
    asked = curve.demand(samples.command, samples.voltage)
    thrust = np.exp(asked).mean(axis=1)
    together = math.log(float(thrust.mean()) / float(samples.load_factor.mean()))
    return np.asarray(together + np.median(asked - np.log(thrust)[:, None], axis=0))


def _trail(flight: AirborneFlight, curve: DriveCurve, samples: DriveSamples) -> Array:
    speed = flight.channels["velocity"][flight.driven]
    yaw = curve.demand(samples.command, samples.voltage) @ MODES[3]
    excited = np.std(speed, axis=0) > _MOVED
    out = np.full(2, np.nan)
    rows = np.column_stack([np.ones(yaw.size), speed[:, excited]])
    out[excited] = np.linalg.lstsq(rows, yaw, rcond=None)[0][1:]
    return out


def _swing(flight: AirborneFlight) -> float:
    """Return the logarithm of the horizontal acceleration in the band of pendulums."""
    step = flight.step
    if not _shows(flight.log.series["position"], 1.2 * _SWING_HZ[1]):
        return float("nan")
    long = [x[:, :2] for x in flight.parts("position") if len(x) * step >= _SHORTEST_S - 1.5]
    sos = butter(2, _SWING_HZ, "band", fs=1.0 / step, output="sos")
    swings = [sosfiltfilt(sos, x, axis=0) for x in long]
    return _log_rms([np.gradient(np.gradient(x, step, axis=0), step, axis=0) for x in swings])


def _shake(flight: AirborneFlight, parts: Sequence[Array], source: Series | None) -> float:
    """Return the logarithm of the standard deviation of parts of a channel above `_SHAKE_HZ`."""
    if source is None or not _shows(source, 2.0 * _SHAKE_HZ):
        return float("nan")
    sos = butter(4, _SHAKE_HZ, "high", fs=1.0 / flight.step, output="sos")
    return _log_rms([sosfiltfilt(sos, x, axis=0) for x in parts])


def _shows(series: Series, frequency: float) -> bool:
    """Return whether a channel is fast enough to show a frequency [Hz]."""
    step = sample_interval(series.t)
    return step > 0.0 and 0.5 / step >= frequency


def _log_rms(parts: Sequence[Array]) -> float:
    """Return the logarithm of the root mean square of rows; NaN: there are none."""
    if not parts:
        return float("nan")
    every = np.vstack(parts)
    return float(np.log(np.sqrt(np.mean(np.sum(every**2, axis=1))) + _FLOOR))

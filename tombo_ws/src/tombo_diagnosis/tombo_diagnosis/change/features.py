"""Features of a flight that describe its vehicle: demand of each rotor, vibration, oscillation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Flight, Series, why_left_out
from tombo_diagnosis.flight.fit.drive_curve import DriveCurve, DriveSamples
from tombo_diagnosis.rotor_demand import MODES
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import turns_at, usable_turns
from tombo_logs.checks.spans import interpolated, merged, sample_interval
from tombo_logs.checks.track_smoothing import smooth_track

_SUPPLY_S = 5.0
"""Over which the voltage is averaged: long against manoeuvres, short against a discharge."""
_EDGE_S = 0.5
"""After lift-off and before touch-down."""
_SHORTEST_S = 4.0
"""Of a stretch in the air."""
_BRIDGED_S = 1.0
"""Length of an excluded span up to which the flight stays in one part: poses that jump, a gap."""
_SHAKE_HZ = 10.0
"""Above it no loop follows: the remainder is vibration."""
_SWING_HZ = (0.35, 1.6)
"""Of pendulums of 2 m to 0.1 m."""
_FLOOR = 1e-6
_SPEED_S = 0.3
"""Over which a velocity is taken."""
_MOVED = 0.1
"""Standard deviation of a velocity [m/s] from which on it says something."""


@dataclass(frozen=True)
class AirborneFlight:
    """The channels of a flight and the time that it is steadily in the air."""

    log: Flight
    drive: str
    """One of DRIVES."""
    spans: tuple[tuple[float, float], ...]
    """[s]"""

    def segments(self, series: Series) -> list[Series]:
        """Return the part of a channel in each span."""
        rows = [(series.t >= b) & (series.t <= e) for b, e in self.spans]
        return [Series(series.t[r], series.values[r]) for r in rows if np.count_nonzero(r) > 20]

    @property
    def used_s(self) -> float:
        """Time in the air [s]."""
        return sum(e - b for b, e in self.spans)


@dataclass(frozen=True)
class Features:
    """Features of one flight. NaN: its channels don't say it."""

    demand: Array
    """(4,) logarithm of thrust over a quarter of the weight that the healthy drive curve reads."""
    shake: Array
    """(2,) logarithm of the standard deviation above 10 Hz: of the demand of the rotors against
    each other, as a share; of the acceleration [m/s^2]."""
    swing: float
    """Logarithm of the horizontal acceleration from 0.35 to 1.6 Hz [m/s^2]."""
    trail: Array
    """(2,) yaw part of the demand per speed ahead and to the left [s/m]: drag off the centre turns
    the vehicle one way on the way out, and the other way on the way back. Without an attitude
    ahead is map x."""
    supply: float = float("nan")
    """Mean logarithm of the voltage."""

    @property
    def vector(self) -> Array:
        """(9,) demand, shake, swing, trail."""
        return np.concatenate([self.demand, self.shake, [self.swing], self.trail])

    @staticmethod
    def of(vector: Array, supply: float) -> Features:
        """Return the features of such a vector."""
        return Features(vector[:4], vector[4:6], float(vector[6]), vector[7:], supply)


def mean_of(flights: Sequence[Features]) -> Features:
    """Return the mean of what flights say."""
    supply = float(np.mean([f.supply for f in flights]))
    return Features.of(np.mean([f.vector for f in flights], axis=0), supply)


def airborne(log: Flight) -> AirborneFlight:
    """Find when a checked flight is steadily in the air.

    Raises:
        InputError: no position, no rotor commands or speeds, or never in the air.
    """
    series = log.series
    drive = next((d for d in DRIVES if d in series and series[d].t.size > 20), None)
    if drive is None or "position" not in series or series["position"].t.size < 20:
        why = why_left_out(log.findings, ("position", *DRIVES))
        raise InputError(
            f"flight '{log.name}': usable channels are {', '.join(series)}{why}; needed to say "
            f"what has changed: position, and one of {', '.join(DRIVES)}; or, with an airframe, "
            "thrust_setpoint and torque_setpoint"
        )
    position = series["position"]
    apart = [(b, e) for b, e in merged(log.exclude) if e - b > _BRIDGED_S]
    low, high = (f(position.t[i], series[drive].t[i]) for f, i in ((max, 0), (min, -1)))
    edges = [low, *(x for span in apart for x in span), high]
    pairs = [(b, e) for b, e in list(pairwise(edges))[::2]]
    spans = tuple((b + _EDGE_S, e - _EDGE_S) for b, e in pairs if e - b > _SHORTEST_S)
    if not spans:
        raise InputError(
            f"flight '{log.name}' is never in the air for {_SHORTEST_S:g} s; needed to say what "
            "has changed"
        )
    return AirborneFlight(log, drive, spans)


def drive_samples(flight: AirborneFlight) -> DriveSamples:
    """Return commands, load factor and voltage at the times of the commands.

    Measured speeds give thrust whatever the supply: their voltage is left out.
    """
    series = flight.log.series
    command = _joined(flight.segments(series[flight.drive]))
    keep = (command.values > 0.0).all(axis=1)
    t, values = command.t[keep], command.values[keep]
    supply = None if flight.drive == "rotor_speed" else _supply(flight, t)
    load = _load_factor(series, t)
    sag = None
    if supply is not None:
        raw = series["voltage"]
        sag = np.log(np.interp(t, raw.t, raw.values[:, 0]) / supply)
    return DriveSamples(values, load, supply, sample_interval(t), sag)


def _load_factor(series: Mapping[str, Series], t: Array) -> Array:
    """Return thrust over weight at `t`: of the accelerometer, an estimator, or the smoothed track.

    Of the latter two it is the part along the body's z; without an attitude their size.
    """
    if "accel" in series:
        return np.asarray(_at(series["accel"], t)[:, 2] / GRAVITY)
    if "acceleration" in series:
        pushed = _at(series["acceleration"], t)
    else:
        track = smooth_track(series["position"])
        pushed = _at(track["acceleration"], t)
    force = pushed / GRAVITY + np.array([0.0, 0.0, 1.0])
    if "attitude" in series:
        return np.asarray(_attitude(series["attitude"], t).inv().apply(force)[:, 2])
    return np.asarray(np.linalg.norm(force, axis=1))


def _at(series: Series, t: Array) -> Array:
    return interpolated(t, series.t, series.values)


def _attitude(series: Series, t: Array) -> Rotation:
    return turns_at(usable_turns(series), t)


def _supply(flight: AirborneFlight, t: Array) -> Array | None:
    """Return the slow part of the voltage at `t`; None: not measured.

    Faster changes follow the current, through the battery's resistance: it says what the rotors
    took, not what they were given.
    """
    raw = flight.log.series.get("voltage")
    if raw is None or not (raw.values > 0.0).all():
        return None
    voltage = np.zeros(t.size)
    for begin, end in flight.spans:
        inside = (raw.t >= begin) & (raw.t <= end)
        if not inside.any():
            return None
        width = max(1, round(_SUPPLY_S / max(sample_interval(raw.t), 1e-3)))
        slow = uniform_filter1d(raw.values[inside, 0], width, mode="reflect")
        rows = (t >= begin) & (t <= end)
        voltage[rows] = np.interp(t[rows], raw.t[inside], slow)
    return voltage


def features(flight: AirborneFlight, curve: DriveCurve) -> Features:
    """Return a flight's features, with the drive curve of the healthy flights."""
    series, samples = flight.log.series, drive_samples(flight)
    demand = _demand(curve, samples)
    asked = [
        Series(s.t, (np.maximum(s.values, 1e-9) ** curve.exponent) @ MODES[1:].T)
        for s in flight.segments(series[flight.drive])
    ]
    level = float(np.mean(samples.command**curve.exponent))
    acceleration = next((series[n] for n in ("accel", "acceleration") if n in series), None)
    shake = [
        _band(asked, _SHAKE_HZ, 1.0 / level),
        _band(flight.segments(acceleration), _SHAKE_HZ, 1.0)
        if acceleration is not None
        else np.nan,
    ]
    track = [Series(s.t, s.values[:, :2]) for s in flight.segments(series["position"])]
    supply = float("nan") if samples.voltage is None else float(np.log(samples.voltage).mean())
    return Features(demand, np.array(shake), _swing(track), _trail(flight, curve), supply)


def _demand(curve: DriveCurve, samples: DriveSamples) -> Array:
    """Return the demand of each rotor in level flight at one height (4,).

    Thrust that manoeuvres ask for is in the load factor, too, and so drops out; means, not medians
    or means of logarithms: these depend on manoeuvres and on vibration.
    """
    asked = curve.demand(samples.command, samples.voltage)
    thrust = np.exp(asked).mean(axis=1)
    together = math.log(float(thrust.mean()) / float(samples.load_factor.mean()))
    return np.asarray(together + np.median(asked - np.log(thrust)[:, None], axis=0))


def _trail(flight: AirborneFlight, curve: DriveCurve) -> Array:
    series, samples = flight.log.series, drive_samples(flight)
    command = _joined(flight.segments(series[flight.drive]))
    t = command.t[(command.values > 0.0).all(axis=1)]
    position = series["position"]
    half = 0.5 * _SPEED_S
    ends = [interpolated(t + d, position.t, position.values[:, :2]) for d in (-half, half)]
    speed = (ends[1] - ends[0]) / _SPEED_S
    if "attitude" in series:
        ahead = _attitude(series["attitude"], t).apply([1.0, 0.0, 0.0])
        heading = np.arctan2(ahead[:, 1], ahead[:, 0])
        ahead = np.cos(heading) * speed[:, 0] + np.sin(heading) * speed[:, 1]
        left = np.cos(heading) * speed[:, 1] - np.sin(heading) * speed[:, 0]
        speed = np.column_stack([ahead, left])
    yaw = curve.demand(samples.command, samples.voltage) @ MODES[3]
    excited = np.std(speed, axis=0) > _MOVED
    out = np.full(2, np.nan)
    rows = np.column_stack([np.ones(t.size), speed[:, excited]])
    out[excited] = np.linalg.lstsq(rows, yaw, rcond=None)[0][1:]
    return out


def _swing(track: Sequence[Series]) -> float:
    """Return the logarithm of the horizontal acceleration in the band of pendulums."""
    long = [s for s in track if s.t[-1] - s.t[0] >= _SHORTEST_S - 1.5]
    parts = [
        np.gradient(np.gradient(x, step, axis=0), step, axis=0)
        for x, step in _filtered(long, 2, _SWING_HZ, "band", 1.2 * _SWING_HZ[1])
    ]
    return _log_rms(parts)


def _band(parts: Sequence[Series], low: float, factor: float) -> float:
    """Return the logarithm of the standard deviation above a frequency [Hz], times a factor."""
    return _log_rms([factor * x for x, _ in _filtered(parts, 4, low, "high", 2.0 * low)])


def _filtered(
    parts: Sequence[Series], order: int, band: Any, kind: str, least: float
) -> list[tuple[Array, float]]:
    """Return channels at even times behind a Butterworth filter, each with its step [s].

    Those that are too slow to show a frequency of `least` [Hz] are left out.
    """
    out = []
    for s in parts:
        step = sample_interval(s.t)
        if step <= 0.0 or 0.5 / step < least:
            continue
        even = interpolated(np.arange(s.t[0], s.t[-1], step), s.t, s.values)
        sos = butter(order, band, kind, fs=1.0 / step, output="sos")
        out.append((sosfiltfilt(sos, even, axis=0), step))
    return out


def _log_rms(parts: Sequence[Array]) -> float:
    """Return the logarithm of the root mean square of rows; NaN: there are none."""
    if not parts:
        return float("nan")
    every = np.vstack(parts)
    return float(np.log(np.sqrt(np.mean(np.sum(every**2, axis=1))) + _FLOOR))


def _joined(parts: Sequence[Series]) -> Series:
    return Series(np.concatenate([s.t for s in parts]), np.vstack([s.values for s in parts]))

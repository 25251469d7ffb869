"""What a flight says of its vehicle: demand of each rotor, how it shakes, how it swings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt

from tombo_diagnosis.flight.fit.drive_curve import DriveCurve, DriveSamples
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.ground import ground_spans
from tombo_logs.checks.series_cleaning import clean_series
from tombo_logs.checks.spans import merged, sample_interval
from tombo_logs.flight_log import DRIVES, Finding, FlightLog, Series

EXPONENT = {"rotor_speed": 2.0, "rotor_command": 2.0, "motor_command": 1.0}
"""Of thrust in each of them, before the fit."""
_SUPPLY_S = 5.0
"""Over which the voltage is averaged: long against manoeuvres, short against a discharge."""
_EDGE_S = 0.5
"""After lift-off and before touch-down."""
_SHORTEST_S = 4.0
"""Of a stretch in the air."""
_SHAKE_HZ = 10.0
"""Above it no loop follows: what is left is vibration."""
_SWING_HZ = (0.35, 1.6)
"""Of pendulums of 2 m to 0.1 m."""
_FLOOR = 1e-6
_SPEED_S = 0.3
"""Over which a velocity is taken."""
_MOVED = 0.1
"""Standard deviation of a velocity [m/s] from which on it says something."""

MODES = np.array([[1.0, 1, 1, 1], [-1, 1, 1, -1], [-1, 1, -1, 1], [1, 1, -1, -1]]) / 4.0
"""Collective, roll, pitch and yaw part of four numbers in the order of ROTOR_NAMES."""


@dataclass(frozen=True)
class AirborneFlight:
    """The channels of a flight and the time that it is steadily in the air."""

    name: str
    log: FlightLog
    drive: str
    """One of DRIVES."""
    spans: tuple[tuple[float, float], ...]
    """[s]"""
    findings: tuple[Finding, ...]

    def cut(self, series: Series) -> list[Series]:
        """Return the part of a channel in each span."""
        rows = [(series.t >= b) & (series.t <= e) for b, e in self.spans]
        return [Series(series.t[r], series.values[r]) for r in rows if np.count_nonzero(r) > 20]

    @property
    def used_s(self) -> float:
        """Time in the air [s]."""
        return sum(e - b for b, e in self.spans)


@dataclass(frozen=True)
class Features:
    """What one flight says. NaN: its channels don't say it."""

    demand: Array
    """(4,) logarithm of thrust over a quarter of the weight that the healthy drive curve reads."""
    shake: Array
    """(2,) logarithm of the standard deviation above 10 Hz: of what the rotors are asked for
    against each other, as a share; of the acceleration [m/s^2]."""
    swing: float
    """Logarithm of the horizontal acceleration from 0.35 to 1.6 Hz [m/s^2]."""
    trail: Array
    """(2,) yaw part of the demand per speed ahead and to the left [s/m]: what drags beside the
    centre turns the vehicle one way on the way out, the other way on the way back. Without an
    attitude ahead is map x."""
    supply: float = float("nan")
    """Mean logarithm of the voltage."""


def airborne(log: FlightLog) -> AirborneFlight:
    """Clean a flight and find when it is in the air.

    Raises:
        InputError: no position, no rotor commands or speeds, or never in the air.
    """
    series, findings = {}, list(log.findings)
    for name, raw in log.series.items():
        series[name], found = clean_series(log.name, name, raw)
        findings += found
    drive = next((d for d in DRIVES if d in series and series[d].t.size > 20), None)
    if drive is None or "position" not in series or series["position"].t.size < 20:
        raise InputError(
            f"flight '{log.name}': channels {', '.join(series)}; needed to say what has changed: "
            f"position, and one of {', '.join(DRIVES)}"
        )
    position = series["position"]
    apart = merged([*log.exclude, *ground_spans(position, series)])
    low, high = (f(position.t[i], series[drive].t[i]) for f, i in ((max, 0), (min, -1)))
    edges = [low, *(x for span in apart for x in span), high]
    pairs = [(b, e) for b, e in list(pairwise(edges))[::2]]
    spans = tuple((b + _EDGE_S, e - _EDGE_S) for b, e in pairs if e - b > _SHORTEST_S)
    if not spans:
        raise InputError(
            f"flight '{log.name}' is never in the air for {_SHORTEST_S:g} s; needed to say what "
            "has changed"
        )
    cleaned = FlightLog(
        log.name, log.source, series, log.airframe, log.findings, log.exclude, log.metadata
    )
    return AirborneFlight(log.name, cleaned, drive, spans, tuple(findings))


def drive_samples(flight: AirborneFlight) -> DriveSamples:
    """Return commands, load factor and voltage at the times of the commands."""
    series = flight.log.series
    command = _joined(flight.cut(series[flight.drive]))
    keep = (command.values > 0.0).all(axis=1)
    t, values = command.t[keep], command.values[keep]
    load = np.ones(t.size)
    if "acceleration" in series:
        s = series["acceleration"]
        load += np.interp(t, s.t, s.values[:, 2]) / GRAVITY
    elif "accel" in series:
        load = np.interp(t, series["accel"].t, series["accel"].values[:, 2]) / GRAVITY
    return DriveSamples(values, np.clip(load, 0.3, 3.0), _supply(flight, t), sample_interval(t))


def _supply(flight: AirborneFlight, t: Array) -> Array | None:
    """Return the slow part of the voltage at `t`; None: not measured.

    What is faster follows the current, through the battery's resistance: it says what the rotors
    took, not what they were given.
    """
    raw = flight.log.series.get("voltage")
    if raw is None or not (raw.values > 0.0).all():
        return None
    found = np.zeros(t.size)
    for begin, end in flight.spans:
        own = (raw.t >= begin) & (raw.t <= end)
        if not own.any():
            return None
        width = max(1, round(_SUPPLY_S / max(sample_interval(raw.t), 1e-3)))
        slow = uniform_filter1d(raw.values[own, 0], width, mode="reflect")
        rows = (t >= begin) & (t <= end)
        found[rows] = np.interp(t[rows], raw.t[own], slow)
    return found


def features(flight: AirborneFlight, curve: DriveCurve) -> Features:
    """Return what a flight says, its commands read with the curve of the healthy flights."""
    series, samples = flight.log.series, drive_samples(flight)
    demand = np.median(curve.demand(samples.command, samples.voltage), axis=0)
    asked = [
        Series(s.t, (np.maximum(s.values, 1e-9) ** curve.exponent) @ MODES[1:].T)
        for s in flight.cut(series[flight.drive])
    ]
    level = float(np.mean(samples.command**curve.exponent))
    felt = next((series[n] for n in ("accel", "acceleration") if n in series), None)
    shake = [
        _band(asked, _SHAKE_HZ, 1.0 / level),
        _band(flight.cut(felt), _SHAKE_HZ, 1.0) if felt is not None else np.nan,
    ]
    track = [Series(s.t, s.values[:, :2]) for s in flight.cut(series["position"])]
    supply = float("nan") if samples.voltage is None else float(np.log(samples.voltage).mean())
    return Features(demand, np.array(shake), _swing(track), _trail(flight, curve), supply)


def _trail(flight: AirborneFlight, curve: DriveCurve) -> Array:
    series, samples = flight.log.series, drive_samples(flight)
    command = _joined(flight.cut(series[flight.drive]))
    t = command.t[(command.values > 0.0).all(axis=1)]
    position = series["position"]
    half = 0.5 * _SPEED_S
    ends = [
        np.column_stack([np.interp(t + d, position.t, v) for v in position.values[:, :2].T])
        for d in (-half, half)
    ]
    speed = (ends[1] - ends[0]) / _SPEED_S
    if "attitude" in series:
        q = np.column_stack(
            [
                np.interp(t, series["attitude"].t, v)
                for v in unwrap_quaternions(series["attitude"].values).T
            ]
        )
        x, y, z, w = q.T
        heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
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
    parts = []
    for s in track:
        step = sample_interval(s.t)
        if step <= 0.0 or 0.5 / step < 1.2 * _SWING_HZ[1] or s.t[-1] - s.t[0] < _SHORTEST_S - 1.5:
            continue
        t = np.arange(s.t[0], s.t[-1], step)
        even = np.column_stack([np.interp(t, s.t, v) for v in s.values.T])
        sos = butter(2, _SWING_HZ, "band", fs=1.0 / step, output="sos")
        second = np.gradient(
            np.gradient(sosfiltfilt(sos, even, axis=0), step, axis=0), step, axis=0
        )
        parts.append(second)
    return _log_rms(parts)


def _band(parts: Sequence[Series], low: float, factor: float) -> float:
    """Return the logarithm of the standard deviation in a band; NaN where sampled too slowly."""
    out = []
    for s in parts:
        step = sample_interval(s.t)
        if step <= 0.0 or 0.5 / step < 2.0 * low:
            continue
        t = np.arange(s.t[0], s.t[-1], step)
        even = np.column_stack([np.interp(t, s.t, v) for v in s.values.T])
        sos = butter(4, low, "high", fs=1.0 / step, output="sos")
        out.append(factor * sosfiltfilt(sos, even, axis=0))
    return _log_rms(out)


def _log_rms(parts: Sequence[Array]) -> float:
    if not parts:
        return float("nan")
    every = np.vstack(parts)
    return float(np.log(np.sqrt(np.mean(np.sum(every**2, axis=1))) + _FLOOR))


def _joined(parts: Sequence[Series]) -> Series:
    return Series(np.concatenate([s.t for s in parts]), np.vstack([s.values for s in parts]))

"""The motion and the drives of one flight on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Flight, Series
from tombo_diagnosis.control.oscillation import course_rates, needed_rates
from tombo_diagnosis.control.signals import ControlSignals, control_signals
from tombo_diagnosis.rotor_demand import EXPONENT
from tombo_diagnosis.track_smoothing import position_noise, smooth_track
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.clocks.stamps import jitter
from tombo_logs.checks.even_flight import (
    EVENT_WIDTH,
    PUSH_WIDTH,
    EvenFlight,
    known_at,
    resample,
    smooth,
    turns_at,
    usable_turns,
)
from tombo_logs.checks.ground import ground_spans
from tombo_logs.checks.pipeline import recorded
from tombo_logs.checks.samples import interpolated_spans, nothing_left
from tombo_logs.checks.spans import Mask, check_extent, inside, interpolated, sample_interval

RATE: Final = 100.0
"""Hz of the clock."""
_LAGS: Final = np.arange(0.0, 0.09, 0.01)
"""s by which thrust may follow the drives."""
_LEARNT: Final = 0.5
"""Share of the flight, from its start, from which is learnt what is usual."""
_MEASURED: Final = ("gyro", "accel", "rotor_speed", "motor_command", "voltage", "current")
_LINE_S: Final = 0.3
"""Straight lines of them that are longer were drawn through a gap."""
_JITTER: Final = 0.3
"""Of stamps, over their step, from which on they make jumps of their own."""
UPSET_TILT_RAD: Final = np.radians(60.0)
_SETTLED_S: Final = 0.5
"""Time after lift-off, or after the log's start."""
_SHORTEST_S: Final = 0.9
"""Flight [s]: a second of poses at 10 Hz or more."""
_KNOWN_S: Final = 0.08
"""Beside a sample up to which a channel is known."""


@dataclass(frozen=True)
class CrashMotion(EvenFlight):
    """A flight on a clock of 100 Hz; NaN: not known.

    Its channels are rates and acceleration (of the track); rows are valid where poses are there.
    """

    log: Flight
    series: Mapping[str, Series]
    """Cleaned."""
    noise: float
    """Standard deviation of a position [m]."""
    height: Array
    """(N,) m"""
    speed: Array
    """(N, 3) m/s, map"""
    tilt: Array
    """(N,) rad"""
    force: Array
    """(N, 3) specific force [m/s^2], body"""
    demand: Array
    """(N, 4) of the best drive channel over its usual mean, in terms of thrust."""
    flying: Mask
    """Samples in the air."""
    even: bool
    """Stamps of the poses are so even that jumps and fast swings can be told."""
    learnt: Mask
    """The part from which is learnt what is usual."""
    controlled: ControlSignals | None
    """Inputs and set points of the controller; None: too little."""
    course: Array
    """(N, 3) body rates that the course needs [rad/s]; about z NaN: no heading is asked for."""
    missing: Array
    """(N,) thrust over hover's that is there beyond what the drives ask for; NaN: no drives."""

    def index(self, time: float) -> int:
        """Return the row of a time [s]."""
        return int(np.clip(np.searchsorted(self.t, time), 0, self.t.size - 1))


def crash_motion(log: Flight) -> CrashMotion:
    """Lay a flight on one clock.

    Raises:
        InputError: no position, or never in the air.
    """
    channels, _ = recorded(log)
    log = log.with_series(channels)
    series = {n: s for n, raw in channels.items() if not nothing_left(s := _measured(n, raw))}
    position = series.get("position")
    if position is None or position.t.size < 20 or np.ptp(position.t) < _SHORTEST_S:
        raise InputError(
            f"flight '{log.name}': usable channels are {', '.join(series) or 'none'}; needed to "
            "say why it crashed: position, for a second at least"
        )
    end = max(s.t[-1] for n, s in series.items() if n in ("position", "gyro", "accel", *DRIVES))
    check_extent(position.t[0], end, RATE)
    t = np.arange(position.t[0], end, 1.0 / RATE)
    track, noise = smooth_track(position), position_noise(position)
    seen = known_at(position, t, _KNOWN_S)
    place, speed, pushed = (
        interpolated(t, track.t, track[name].values)
        for name in ("position", "velocity", "acceleration")
    )
    flying = ~inside(t, ground_spans(position, series))
    if np.count_nonzero(flying) < RATE:
        flying = np.ones(t.size, np.bool_)
    up, rates = _attitude(series, t)
    even = jitter(position.t) < _JITTER * sample_interval(position.t)
    gyro = series.get("gyro")
    if gyro is None and not even:
        rates = np.full_like(rates, np.nan)
    if gyro is not None:
        rates = _smooth(gyro, t, EVENT_WIDTH)
    tilt = np.where(seen, np.arccos(np.clip(up[:, 2, 2], -1.0, 1.0)), np.nan)
    accel = series.get("accel")
    if accel is not None:
        force = _smooth(accel, t, PUSH_WIDTH)
    else:
        force = np.einsum("nji,nj->ni", up, pushed + np.array([0.0, 0.0, GRAVITY]))
        force[~seen] = np.nan
    rows = np.flatnonzero(flying)
    first, last = int(rows[0]), int(rows[-1])
    upset = np.flatnonzero(np.nan_to_num(tilt) > UPSET_TILT_RAD)
    last = min(last, int(upset[0])) if upset.size and upset[0] > first + RATE else last
    row = np.arange(t.size)
    settled = min(first + round(_SETTLED_S * RATE), (first + last) // 4)
    learnt = flying & (row >= settled) & (row < first + _LEARNT * (last - first))
    demand = _demand(series, t, learnt)
    missing = _missing(demand, force[:, 2], learnt)
    controlled = control_signals(log, None)
    if controlled is not None:
        course = interpolated(t, controlled.t, course_rates(controlled))
    else:
        course = needed_rates(place, 3, 1.0 / RATE, Rotation.from_matrix(up))
    return CrashMotion(
        t, {"rates": rates, "acceleration": pushed}, seen, log, series, noise, place[:, 2], speed,
        tilt, force, demand, flying, even, learnt, controlled, course, missing,
    )  # fmt: skip


def _measured(name: str, series: Series) -> Series:
    """Return the measured samples of a channel: no straight lines, no attitudes that are none."""
    if name in _MEASURED and series.t.size:
        lines = [(b, e) for b, e in interpolated_spans(series.t, series.values) if e - b > _LINE_S]
        keep = ~inside(series.t, lines)
        series = Series(series.t[keep], series.values[keep])
    if name == "attitude" and series.t.size:
        return usable_turns(series)
    return series


def _smooth(series: Series, t: Array, width: float) -> Array:
    """Return a channel on the clock behind a Gaussian [s]; NaN where it is not known."""
    out = smooth(resample(series, t), width, 1.0 / RATE)
    out[~known_at(series, t, _KNOWN_S)] = np.nan
    return out


def _attitude(series: Mapping[str, Series], t: Array) -> tuple[Array, Array]:
    """Return matrices (N, 3, 3), map from body, and body rates (N, 3); level: no attitude."""
    attitude = series.get("attitude")
    if attitude is None:
        return np.tile(np.eye(3), (t.size, 1, 1)), np.full((t.size, 3), np.nan)
    turns = turns_at(attitude, t)
    steps = np.zeros((t.size, 3))
    steps[1:] = (turns[:-1].inv() * turns[1:]).as_rotvec() * RATE
    rates = smooth(steps, EVENT_WIDTH, 1.0 / RATE)
    rates[~known_at(attitude, t, _KNOWN_S)] = np.nan
    return turns.as_matrix(), rates


def _demand(series: Mapping[str, Series], t: Array, learnt: Mask) -> Array:
    name = next((d for d in DRIVES if d in series), None)
    if name is None:
        return np.full((t.size, 4), np.nan)
    thrust = np.maximum(_smooth(series[name], t, EVENT_WIDTH), 0.0) ** EXPONENT[name][0]
    usual = float(np.nanmedian(thrust[learnt])) if np.isfinite(thrust[learnt]).any() else 0.0
    return thrust / usual if usual > 0.0 else np.full((t.size, 4), np.nan)


def _missing(demand: Array, force: Array, learnt: Mask) -> Array:
    """Return thrust beyond what is asked for, with the lag that explains most."""
    asked = demand.mean(axis=1)
    rows = learnt & np.isfinite(asked) & np.isfinite(force)
    if np.count_nonzero(rows) < RATE:
        return np.full(asked.size, np.nan)
    tried = []
    for lag in _LAGS.tolist():
        late = asked[np.maximum(np.arange(asked.size) - round(lag * RATE), 0)]
        lift = float(np.median(force[rows] / np.maximum(late[rows], 1e-3)))
        missing = force / max(lift, 1e-3) - late
        tried.append((float(np.std(missing[rows])), lag, missing))
    return np.asarray(min(tried, key=lambda each: each[:2])[2])

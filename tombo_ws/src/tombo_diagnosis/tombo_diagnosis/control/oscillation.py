"""Loops that swing: about which axis, how fast, since when, and which loop drives it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt, welch
from scipy.spatial.transform import Rotation

from tombo_diagnosis.control.gains import attitude_error, follows
from tombo_diagnosis.control.signals import ControlSignals
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.spans import Mask

SWING_HZ: Final = (0.9, 20.0)
SWING_RAD_S: Final = 0.8
"""rad/s: standard deviation of rates in the band from which on it is an oscillation."""
BEYOND: Final = 2.0
"""Least ratio of rates in the band to the rates that the course needs, about both axes together: a
figure-eight is in one axis twice as fast as in the other."""
_COURSE_HZ: Final = 2.5
"""A course has nothing above it."""
_MOVES: Final = 0.05
"""m/s or m by which a set point changes at least that is a course."""
_WINDOW_S: Final = 2.0
_FOLLOWS: Final = 0.7
"""Swing of a set point over that of the response from which on the loop outside drives it."""


@dataclass(frozen=True)
class Oscillation:
    """A loop that swings."""

    axis: str
    """roll or pitch"""
    hertz: float
    size: float
    """Standard deviation of the body rate [rad/s]."""
    loop: str
    """rate, attitude, position; empty: without set points nobody knows."""
    begin_s: float

    @property
    def text(self) -> str:
        """Description, as a sentence without its full stop."""
        loop = f"the {self.loop} loop" if self.loop else "a loop (set points are not in the log)"
        return f"{loop} oscillates about {self.axis} at {self.hertz:.1f} Hz, {self.size:.1f} rad/s"


def oscillation(s: ControlSignals) -> Oscillation | None:
    """Return the strongest swing of roll and pitch that no course asks for, if there is one."""
    if not s.gyro.size or np.count_nonzero(s.valid) * s.step < _WINDOW_S:
        return None
    rows = s.valid & np.isfinite(s.gyro).all(axis=1)
    turned, needed = (
        [_peak(values[rows, k], s.step) for k in (0, 1)] for values in (s.gyro, course_rates(s))
    )
    if math.hypot(*(size for _, size in turned)) < BEYOND * math.hypot(*(x for _, x in needed)):
        return None
    k = int(turned[1][1] >= turned[0][1])
    hertz, size = turned[k]
    if size < SWING_RAD_S:
        return None
    return Oscillation(("roll", "pitch")[k], hertz, size, _loop(s, k, hertz), _begin(s, k))


def _peak(values: Array, step: float) -> tuple[float, float]:
    """Return the frequency [Hz] with most power in the band, and the standard deviation there."""
    length = int(min(len(values), _WINDOW_S / step))
    hertz, power = welch(values, 1.0 / step, nperseg=length)
    band = (hertz > SWING_HZ[0]) & (hertz < SWING_HZ[1])
    if not band.any():
        return 0.0, 0.0
    size = np.sqrt(power[band].sum() * (hertz[1] - hertz[0]))
    return float(hertz[band][np.argmax(power[band])]), float(size)


def course_rates(s: ControlSignals) -> Array:
    """Return the body rates (N, 3) that the course needs, as asked for or as flown.

    Without set points the course is what was flown: rates that move the vehicle are a manoeuvre.
    The rate about z is that of the heading that is asked for; NaN: no heading is.
    """
    heading = None
    if s.turns_asked is not None:
        ahead = s.turns_asked.apply([1.0, 0.0, 0.0])
        heading = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    return needed_rates(*_course(s), s.step, s.turns, heading)


def _course(s: ControlSignals) -> tuple[Array, int]:
    """Return the course (N, 3), and which of its derivatives is the jerk.

    It is the first of the set points of velocity and position that moves. A constant velocity set
    point is not a feed-forward of the position loop. Where none moves, the vehicle is asked to
    hover.
    """
    asked = [(s.velocity_asked, 2), (s.position_asked, 3)]
    for course, order in asked:
        if course is not None and np.ptp(course[s.valid], axis=0).max(initial=0.0) > _MOVES:
            return course, order
    return (s.position if s.position_asked is None else s.position_asked), 3


def needed_rates(
    course: Array, order: int, step: float, turns: Rotation | None, heading: Array | None = None
) -> Array:
    """Return the body rates (N, 3) [rad/s] that a course needs.

    Thrust accelerates the vehicle along its body z, so a jerk j needs the rates z x j / g.

    Args:
        course: (N, 3), in map.
        step: time between its rows [s].
        order: of the derivative of the course that is the jerk.
        turns: attitudes; None: level.
        heading: (N,) [rad]; None: not known, and the rates about z are NaN.
    """
    jerk = course
    for _ in range(order):
        jerk = np.gradient(jerk, step, axis=0)
    turning = np.zeros(len(jerk)) if heading is None else np.gradient(heading, step)
    rates = np.column_stack([-jerk[:, 1] / GRAVITY, jerk[:, 0] / GRAVITY, turning])
    sos = butter(4, min(2.0 * _COURSE_HZ * step, 0.9), output="sos")
    rates = sosfiltfilt(sos, rates, axis=0, padtype="even")
    rates = rates if turns is None else turns.inv().apply(rates)
    if heading is None:
        rates[:, 2] = np.nan
    return np.asarray(rates)


def _swing(values: Array, rows: Mask, hertz: float, step: float) -> float:
    low, high = 0.75 * hertz, min(1.3 * hertz, 0.45 / step)
    sos = butter(2, [low, high], "band", fs=1.0 / step, output="sos")
    return float(np.std(sosfiltfilt(sos, np.nan_to_num(values))[rows]))


def _loop(s: ControlSignals, k: int, hertz: float) -> str:
    """Return the innermost loop whose set point swings less than what follows it."""
    if s.turns is None or s.turns_asked is None or not s.gyro.size:
        return ""
    tilts = [r.apply([0.0, 0.0, 1.0])[:, :2] for r in (s.turns_asked, s.turns)]
    asked, there = (
        math.hypot(*(_swing(t[:, i], s.valid, hertz, s.step) for i in (0, 1))) for t in tilts
    )
    if asked > _FOLLOWS * there:
        return "position"
    if s.rates_asked is not None:
        asked = _swing(s.rates_asked[:, k], s.valid, hertz, s.step)
        if asked < _FOLLOWS * _swing(s.gyro[:, k], s.valid, hertz, s.step):
            error = attitude_error(s.turns, s.turns_asked)
            return "rate" if follows(s, error, s.rates_asked) else "attitude"
    return "attitude"


def _begin(s: ControlSignals, k: int) -> float:
    """Return when the swing first has its size [s]."""
    sos = butter(2, SWING_HZ[0], "high", fs=1.0 / s.step, output="sos")
    fast = sosfiltfilt(sos, np.nan_to_num(s.gyro[:, k]))
    size = np.sqrt(np.maximum(uniform_filter1d(fast**2, max(round(0.5 / s.step), 1)), 0.0))
    rows = np.flatnonzero((size > SWING_RAD_S) & s.valid)
    return float(s.t[rows[0]]) if rows.size else float(s.t[np.argmax(s.valid)])

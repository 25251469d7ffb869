"""Whether IMU and rotors are on clocks that run as fast as that of the poses.

The lag between what two sensors see of the same motion is measured in windows along the flight. On
one clock it is constant; between clocks of different rates it grows linearly. Stamps of a clock
whose rate is off are corrected; those of one whose lag changes otherwise can't be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import INDEPENDENT, RATE, EvenFlight, beside_poses
from tombo_logs.checks.spans import Mask, peak_offset

_WINDOW = round(5.0 * RATE)
_HOP = _WINDOW // 2
_REACH = round(0.5 * RATE)
"""Largest lag that is looked for, in rows."""
_MATCH = 0.8
"""Correlation from which on a window's lag counts."""
_SURE_MATCH = 0.95
"""Median correlation from which on lags that scatter are those of the clocks."""
_LEAST_WINDOWS = 4
_GROWTH_S = 0.004
"""s by which a lag may change along a flight without being reported."""
_SIGMAS = 4.0
_UNEVEN_S = 0.03
"""s by which lags may scatter about a straight line."""
_LARGEST_RATE = 0.05
_FAR_RATES = (0.95, 0.96, 0.97, 0.98, 0.99, 1.01, 1.02, 1.03, 1.04, 1.05)
"""Factors of the stamps that are tried where no constant rate near 1 fits."""
_FAR_MATCH = 0.85
"""Median correlation from which on one of them counts."""
_FAR_LEFT = 0.5
"""Share of what lags at the given rate leave uncorrelated that one of them may leave: within a
window a wrong clock slips, where an external force shifts it as a whole."""
_SURE_S = 0.003
"""s to which a lag must be known along a flight for its stamps to be corrected."""
_PASSES = 3
_DRAG = 0.1
"""1/s: drag along the rotors' axis per mass; it is in what the poses show, not in thrust."""
IMU = ("gyro", "accel")


@dataclass(frozen=True)
class LagCourse:
    """How the lag of one sensor against another changes along a flight."""

    rate: float
    """s/s: the other's clock is slow by it, if positive."""
    sigma: float
    """Standard deviation of the rate."""
    significance: float
    """Rate over standard deviation, whichever one window is left out: a single stretch where the
    force is not thrust alone makes no clock slow."""
    growth: float
    """s from the first to the last window."""
    scatter: float
    """Standard deviation of the lags about the line [s]."""
    first: float
    """Lag of the first window [s]."""
    length: float
    """s between first and last window."""
    match: float
    """Median correlation of the windows."""


def lag_course(
    t: Array, seen: Array, other: Array, usable: Mask, drag: float = 0.0
) -> LagCourse | None:
    """Return how the lag of `seen` (N, k) behind `other` (N, k) changes; None: it can't be told.

    Rows are on an even clock `t` (N,) of `RATE`; only those with `usable` count. `drag`:
    per mass [1/s], that one of the two may have in addition to the other.
    """
    times, lags, sigmas, matches = [], [], [], []
    for begin in range(_REACH, t.size - _WINDOW - _REACH + 1, _HOP):
        rows = slice(begin, begin + _WINDOW)
        if np.count_nonzero(usable[begin - _REACH : begin + _WINDOW + _REACH]) < 0.8 * (
            _WINDOW + 2 * _REACH
        ):
            continue
        measured = _window_lag(seen, other[rows], begin, drag)
        if measured is not None:
            times.append(float(t[rows].mean()))
            lags.append(measured[0])
            sigmas.append(measured[1])
            matches.append(measured[2])
    if len(times) < _LEAST_WINDOWS:
        return None
    at, lag, weight = np.array(times), np.array(lags), 1.0 / np.array(sigmas) ** 2
    rate, first, sigma = _line(at - at[0], lag, weight)
    fewer = [_line(*(np.delete(v, k) for v in (at - at[0], lag, weight))) for k in range(at.size)]
    length = float(at[-1] - at[0])
    return LagCourse(
        rate,
        sigma,
        min(abs(fit[0]) / fit[2] for fit in fewer),
        rate * length,
        1.4826 * float(np.median(np.abs(lag - first - rate * (at - at[0])))),
        first,
        length,
        float(np.median(matches)),
    )


def _line(at: Array, lag: Array, weight: Array) -> tuple[float, float, float]:
    """Return rate, value at zero and the rate's sigma; windows overlap by half."""
    rate, first = np.polyfit(at, lag, 1, w=np.sqrt(weight))
    left = lag - first - rate * at
    middle = np.average(at, weights=weight)
    spread = np.sqrt(2.0 / np.sum(weight * (at - middle) ** 2))
    much = max(float(np.sqrt(np.average(left**2, weights=weight) * np.mean(weight))), 1.0)
    return float(rate), float(first), float(spread) * much


def _window_lag(
    seen: Array, other: Array, begin: int, drag: float
) -> tuple[float, float, float] | None:
    """Return lag [s] of `seen` behind a window of `other` from a row on, its sigma, the match."""
    b = other - other.mean(axis=0)
    size_b = float(np.sum(b**2))
    match = np.zeros(2 * _REACH + 1)
    for k in range(match.size):
        first = begin + k - _REACH
        a = seen[first : first + len(b)]
        a = a - a.mean(axis=0)
        match[k] = np.sum(a * b) / np.sqrt(max(float(np.sum(a**2)) * size_b, 1e-24))
    best = int(np.argmax(match))
    if best in (0, match.size - 1) or match[best] < _MATCH:
        return None
    noise = np.sqrt(size_b * (1.0 - match[best] ** 2) / b.size)
    slope = np.gradient(b, 1.0 / RATE, axis=0)
    sharp = np.sqrt(np.sum(slope**2) / INDEPENDENT)
    # Beside an acceleration of this frequency, what goes with the velocity shifts its phase.
    shift = drag * size_b / max(float(np.sum(slope**2)), 1e-9)
    sigma = max(float(np.hypot(noise / max(sharp, 1e-9), shift)), 2e-4)
    return (best - _REACH + peak_offset(match, best)) / RATE, sigma, float(match[best])


def common_clock(
    flight: str, series: Mapping[str, Series], motion: EvenFlight, reset: frozenset[str]
) -> tuple[dict[str, Series], list[Finding]]:
    """Return the channels with IMU and rotors on the poses' clock, and the findings.

    `reset`: channels whose clock was set back, which then need not agree with the others any more.
    """
    series = dict(series)
    findings: list[Finding] = []
    if "gyro" in series and motion.gyro.size:
        alike = [n for n in DRIVES if n in series and _same_stamps(series[n], series["gyro"])]
        names = [*(name for name in IMU if name in series), *alike]
        findings += _on_poses_clock(flight, series, names, motion, "gyro", reset)
    for name in DRIVES:
        if name in series:
            findings += _on_poses_clock(flight, series, [name], motion, name, reset)
    return series, findings


def _course(motion: EvenFlight, channel: str, series: Series) -> LagCourse | None:
    if channel == "gyro":
        covered = motion.valid & (motion.t > series.t[0]) & (motion.t < series.t[-1])
        return lag_course(motion.t, motion.rates, beside_poses(series, motion.t), covered)
    return _rotor_course(motion, series)


def _first_course(
    motion: EvenFlight, channel: str, series: Series
) -> tuple[float, LagCourse] | None:
    """Return a factor for the stamps and the lags that are left then.

    The factor is 1 unless the error of the rate moves lags out of the searched range.
    """
    course = _course(motion, channel, series)
    if course is not None and not _is_uneven(course):
        return 1.0, course
    tried = [(k, _course(motion, channel, _stretched(series, k))) for k in _FAR_RATES]
    even = [
        (k, c) for k, c in tried if c is not None and not _is_uneven(c) and c.match > _FAR_MATCH
    ]
    best = max(even, key=lambda each: each[1].match, default=None)
    if best and (course is None or 1.0 - best[1].match < _FAR_LEFT * (1.0 - course.match)):
        return best
    return None if course is None else (1.0, course)


def _is_uneven(course: LagCourse) -> bool:
    return course.scatter > _UNEVEN_S or abs(course.rate) > _LARGEST_RATE


def _rotor_course(motion: EvenFlight, drive: Series) -> LagCourse | None:
    """Compare the rotors' thrust with the specific force along body z that the poses show."""
    if drive.t.size < 2 or not motion.t.size:
        return None
    thrust = beside_poses(Series(drive.t, (drive.values**2).mean(axis=1, keepdims=True)), motion.t)
    force = motion.acceleration + np.array([0.0, 0.0, GRAVITY])
    along = np.einsum("ni,ni->n", force, motion.up)[:, None]
    covered = motion.valid & (motion.t > drive.t[0]) & (motion.t < drive.t[-1])
    return lag_course(motion.t, along, thrust, covered, _DRAG)


def _on_poses_clock(
    flight: str, series: dict[str, Series], names: list[str], motion: EvenFlight, channel: str,
    reset: frozenset[str],
) -> list[Finding]:  # fmt: skip
    """Correct the stamps of these channels, or leave them out, where the lag is not constant."""
    first = _first_course(motion, channel, series[channel])
    if first is None:
        return []
    stretch, course = first
    changed = ", ".join(names)
    if set(names) & reset and abs(course.first) > 2.0 * _GROWTH_S:
        text = (
            f"{channel}: after its clock was set it is {1e3 * abs(course.first):.0f} ms off the "
            f"poses'; {changed}: left out"
        )
        return _left_out(flight, series, names, channel, text)
    if _is_uneven(course) and (channel not in IMU or course.match < _SURE_MATCH):
        return []  # thrust alone tells a lag too poorly, and so do rates about other axes
    if _is_uneven(course):
        text = (
            f"{channel}: its delay against the poses scatters by {1e3 * course.scatter:.0f} ms "
            f"and changes by {1e3 * course.growth:.0f} ms along the flight; expected: one delay; "
            f"{changed}: left out"
        )
        return _left_out(flight, series, names, channel, text)
    growth = course.growth + (stretch - 1.0) * course.length
    clear = stretch != 1.0 or course.significance > _SIGMAS
    if abs(growth) < max(_GROWTH_S, _SIGMAS * course.sigma * course.length) or not clear:
        return []
    stretch, last = _stretch(motion, channel, series[channel], stretch, course)
    text = (
        f"{channel}: its clock is {100 * abs(1.0 - stretch):.2g} % "
        f"{'slow' if stretch > 1.0 else 'fast'} against the poses', ± {100 * last.sigma:.1g} %: "
        f"their delay changes by {1e3 * growth:.0f} ms along the flight"
    )
    if last.sigma * last.length > _SURE_S or last.scatter > _UNEVEN_S:
        return _left_out(flight, series, names, channel, f"{text}; {changed}: left out")
    for name in names:
        series[name] = _stretched(series[name], stretch)
    text += f"; the stamps of {changed} are multiplied by {stretch:.6f}"
    return [Finding("stamps", "warning", flight, text, channel=channel)]


def _stretch(
    motion: EvenFlight, channel: str, series: Series, stretch: float, course: LagCourse
) -> tuple[float, LagCourse]:
    """Return the factor that makes the lag constant, and the last course.

    Within a window the lag grows, too: it is measured again with corrected stamps.
    """
    for _ in range(_PASSES):
        stretch *= 1.0 + course.rate
        again = _course(motion, channel, _stretched(series, stretch))
        if again is None:
            break
        course = again
    return stretch, course


def _stretched(series: Series, factor: float) -> Series:
    begin = series.t[0]
    return Series(begin + (series.t - begin) * factor, series.values, series.arrival)


def _left_out(
    flight: str, series: dict[str, Series], names: list[str], channel: str, text: str
) -> list[Finding]:
    for name in names:
        del series[name]
    return [Finding("stamps", "fault", flight, text, channel=channel)]


def _same_stamps(series: Series, other: Series) -> bool:
    """Return whether two channels are stamped by one clock: sample by sample alike."""
    return series.t.size == other.t.size and bool(np.abs(series.t - other.t).max() < 1e-6)

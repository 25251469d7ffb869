"""Whether the IMU's clock runs as fast as that of the poses.

The lag between the rates of gyro and attitude is measured in windows along the flight. On one
clock it is constant; between clocks of different rates it grows linearly. Stamps of a clock whose
rate is off are corrected; a lag that changes otherwise can't be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_logs.checks.even_flight import INDEPENDENT, RATE, EvenFlight, beside_poses
from tombo_logs.checks.spans import peak_offset

_WINDOW: Final = round(5.0 * RATE)
"""Rows of a window; the next one begins half a window later."""
_REACH: Final = round(0.5 * RATE)
"""Largest lag that is searched [rows]."""
_MIN_CORRELATION: Final = 0.8
"""Least correlation of a window whose lag counts."""
_MIN_SURE_CORRELATION: Final = 0.95
"""Median of the windows from which on scattering lags are those of the clocks."""
_MIN_WINDOWS: Final = 4
_MIN_GROWTH_S: Final = 0.004
"""Change of the lag along a flight that is reported, and lag that a clock set back may keep."""
_SIGMAS: Final = 4.0
_MAX_SCATTER_S: Final = 0.03
"""Standard deviation of the lags about a straight line."""
_MAX_RATE: Final = 0.05
_PASSES: Final = 4
"""Within a window the lag grows, too: it is measured again with corrected stamps."""


@dataclass(frozen=True)
class LagLine:
    """The lag of the gyro behind the poses as a straight line over time."""

    rate: float
    """s/s: the gyro's clock is slow by it, if positive."""
    sigma: float
    """Standard deviation of the rate."""
    first: float
    """Lag of the first window [s]."""
    length: float
    """Time from the first to the last window [s]."""
    scatter: float
    """Standard deviation of the lags about the line [s]."""
    correlation: float
    """Median of the windows."""

    @property
    def is_even(self) -> bool:
        """Whether the lag is constant, or grows as between two clocks."""
        return self.scatter < _MAX_SCATTER_S and abs(self.rate) < _MAX_RATE


def lag_line(motion: EvenFlight, gyro: Series) -> LagLine | None:
    """Return the lag of a gyro behind the attitude's rates; None: it can't be measured."""
    t, rates = motion.t, beside_poses(gyro, motion.t)
    usable = motion.valid & (t > gyro.t[0]) & (t < gyro.t[-1])
    lags = []
    for begin in range(_REACH, t.size - _WINDOW - _REACH + 1, _WINDOW // 2):
        around = slice(begin - _REACH, begin + _WINDOW + _REACH)
        measured = _lag(motion.rates[around], rates[begin : begin + _WINDOW])
        if usable[around].mean() > 0.8 and measured is not None:
            lags.append((float(t[begin]), *measured))
    if len(lags) < _MIN_WINDOWS:
        return None
    at, lag, sigma, correlation = np.array(lags).T
    at -= at[0]
    rate, first = np.polyfit(at, lag, 1, w=1.0 / sigma)
    left = (lag - first - rate * at) / sigma
    middle = np.average(at, weights=sigma**-2.0)
    spread = np.sqrt(2.0 / np.sum(((at - middle) / sigma) ** 2))  # windows overlap by half
    return LagLine(
        float(rate),
        float(spread) * max(float(np.sqrt(np.mean(left**2))), 1.0),
        float(first),
        float(at[-1]),
        1.4826 * float(np.median(np.abs(left * sigma))),
        float(np.median(correlation)),
    )


def _lag(poses: Array, gyro: Array) -> tuple[float, float, float] | None:
    """Return the lag [s] of a window of the gyro, its standard deviation, and the correlation.

    `poses` (W + 2 R, 3) begin R = `_REACH` rows before the window `gyro` (W, 3), and end as late.
    """
    b = gyro - gyro.mean(axis=0)
    a = np.lib.stride_tricks.sliding_window_view(poses, len(b), axis=0)
    a = a - a.mean(axis=2, keepdims=True)
    sizes = np.sqrt(np.maximum(np.sum(a**2, axis=(1, 2)) * np.sum(b**2), 1e-24))
    correlation = np.einsum("lkw,wk->l", a, b) / sizes
    best = int(np.argmax(correlation))
    top = float(correlation[best])
    if best in (0, correlation.size - 1) or top < _MIN_CORRELATION:
        return None
    noise = np.sqrt(np.mean(b**2) * (1.0 - top**2))
    slope = np.gradient(b, 1.0 / RATE, axis=0)
    sharp = np.sqrt(np.sum(slope**2) / INDEPENDENT)
    lag = (best - _REACH + peak_offset(correlation, best)) / RATE
    return lag, max(float(noise / max(sharp, 1e-9)), 2e-4), top


def common_clock(
    flight: str, series: Mapping[str, Series], motion: EvenFlight, reset: frozenset[str]
) -> tuple[dict[str, Series], list[Finding]]:
    """Return the channels with the IMU on the poses' clock, and the findings.

    Drives with the gyro's stamps are corrected with it.

    Args:
        flight: name.
        series: its channels.
        motion: of poses and IMU.
        reset: channels whose clock was set back; they may differ from the others since.
    """
    series = dict(series)
    line = lag_line(motion, series["gyro"]) if "gyro" in series and motion.gyro.size else None
    if line is None:
        return series, []
    names = [n for n in ("gyro", "accel", *DRIVES) if n in series]
    names = [n for n in names if n in ("gyro", "accel") or _same_stamps(series[n], series["gyro"])]
    fault = _fault(line, bool(reset & set(names)))
    if fault:
        for name in names:
            del series[name]
        text = f"gyro: {fault}; {', '.join(names)}: left out"
        return series, [Finding("stamps", "fault", flight, text, channel="gyro")]
    growth = line.rate * line.length
    least = max(_MIN_GROWTH_S, _SIGMAS * line.sigma * line.length)
    if not line.is_even or abs(growth) < least:
        return series, []
    factor, gyro = 1.0, series["gyro"]
    for _ in range(_PASSES):
        factor *= 1.0 + line.rate
        line = lag_line(motion, _stretched(gyro, factor)) or line
    for name in names:
        series[name] = _stretched(series[name], factor)
    text = (
        f"gyro: its clock is {100 * abs(1.0 - factor):.2g} % {'slow' if factor > 1.0 else 'fast'} "
        f"against the poses', ± {100 * line.sigma:.1g} %: their delay changes by "
        f"{1e3 * growth:.0f} ms along the flight; the stamps of {', '.join(names)} are multiplied "
        f"by {factor:.6f}"
    )
    return series, [Finding("stamps", "warning", flight, text, channel="gyro")]


def _fault(line: LagLine, was_reset: bool) -> str:
    """Return why the stamps can't be corrected, or nothing."""
    if was_reset and abs(line.first) > 2.0 * _MIN_GROWTH_S:
        return f"after its clock was set it is {1e3 * abs(line.first):.0f} ms off the poses'"
    if line.is_even or line.correlation < _MIN_SURE_CORRELATION:
        return ""  # rates about other axes show a lag too poorly
    return (
        f"its delay against the poses scatters by {1e3 * line.scatter:.0f} ms and changes by "
        f"{1e3 * line.rate * line.length:.0f} ms along the flight; expected: one delay"
    )


def _stretched(series: Series, factor: float) -> Series:
    begin = series.t[0]
    return Series(begin + (series.t - begin) * factor, series.values, series.arrival)


def _same_stamps(series: Series, other: Series) -> bool:
    return series.t.size == other.t.size and bool(np.abs(series.t - other.t).max() < 1e-6)

"""Whether all channels have one clock: the lag between what two of them see of the same motion.

It is searched over the whole flight, however far the clocks are apart. A latency, or the answer of
a rotor, lasts a quarter of a second at most; beyond it the stamps are those of another clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.signal import correlate

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ARM_X, ARM_Y, GRAVITY
from tombo_logs.checks.clocks.stamps import gap_spans
from tombo_logs.checks.even_flight import (
    RATE,
    accelerations,
    beside_poses,
    body_rates,
    unit_rows,
    usable_turns,
)
from tombo_logs.checks.samples import interpolated_spans
from tombo_logs.checks.spans import Mask, inside

DELAY_S: Final = 0.25
"""s that a latency or the answer of a rotor may last: more is another clock."""
_MATCH: Final = 0.7
"""Correlation from which on two channels see the same motion."""
_CLEARER: Final = 0.5
"""Largest share of the unexplained part that another clock may leave: a course that repeats itself
is alike after each round, too, but not so alike."""
_SIGMAS: Final = 6.0
"""Correlation over its root mean square at other lags from which on a weaker one counts: the
commands of small motors explain a tenth of the gyro's variance. By chance it reaches 4."""
_ASIDE_S: Final = 1.0
"""s from the best lag from which on others count."""
_OVERLAP: Final = 0.5
"""Share of the shorter channel that must be compared: it was recorded in the same flight."""
_SHORTEST_S, _LONGEST_S = 3.0, 3600.0
"""s of both channels that are compared."""
_OUTLIER: Final = 5.0
"""Times their usual size up to which values count: a blow is not a course."""
_MOMENTS: Final = np.array([ARM_Y, -ARM_X])
"""Rows: moment of a rotor's thrust about body x and y."""
_AHEAD_S: Final = 0.002
"""s by which stamps may be later than arrival: two clocks that are kept together are so close."""


class Signal(NamedTuple):
    """The motion as a sensor sees it, on an even clock of `RATE`."""

    t: Array
    """(N,) s"""
    values: Array
    """(N, k), 0 where they are not known."""
    known: Mask
    """(N,) rows in which the channel was measured."""


@dataclass(frozen=True)
class Match:
    """How well two channels go together."""

    lag: float
    """s by which the other's stamps are later."""
    correlation: float
    at_once: float
    """The largest correlation at a lag that is a delay."""
    usual: float
    """Root mean square of the correlation at other lags."""

    @property
    def is_other_clock(self) -> bool:
        """Whether they see the same motion, but not at the same time."""
        sure = self.correlation >= _MATCH and (
            1.0 - self.correlation < _CLEARER * (1.0 - self.at_once)
        )
        weak = self.correlation >= _SIGMAS * self.usual and (
            self.at_once < _CLEARER * self.correlation
        )
        return abs(self.lag) > DELAY_S and (sure or weak)

    @property
    def is_one_clock(self) -> bool:
        """Whether they see the same motion at the same time."""
        return not self.is_other_clock and self.at_once >= min(_MATCH, _SIGMAS * self.usual)


def match(first: Signal, other: Signal) -> Match | None:
    """Return how well two signals go together at the best lag; None: too short.

    Correlated at each lag are the rows that both have there (Padfield, 2012), by the sum of the
    singular values of their covariance: whatever the axes of each, turned or mirrored.
    """
    if min(np.count_nonzero(s.known) for s in (first, other)) < _SHORTEST_S * RATE:
        return None
    a, b = (s.known.astype(np.float64) for s in (first, other))
    columns_a, columns_b = first.values.T, other.values.T

    def over(x: Array, y: Array) -> Array:
        return np.asarray(correlate(y, x, "full", "fft"))

    count = np.maximum(over(a, b), 1e-9)
    sums_a = [over(x, b) for x in columns_a]
    sums_b = [over(a, y) for y in columns_b]
    size_a = sum(over(x**2, b) - s**2 / count for x, s in zip(columns_a, sums_a, strict=True))
    size_b = sum(over(a, y**2) - s**2 / count for y, s in zip(columns_b, sums_b, strict=True))
    usable = count >= max(_OVERLAP * min(a.sum(), b.sum()), _SHORTEST_S * RATE)
    usable &= np.minimum(size_a, size_b) > 1e-9 * count
    covariance = np.array([
        [(over(x, y) - s_x * s_y / count)[usable]
         for y, s_y in zip(columns_b, sums_b, strict=True)]
        for x, s_x in zip(columns_a, sums_a, strict=True)
    ])  # fmt: skip
    together = np.linalg.svd(np.moveaxis(covariance, 2, 0), compute_uv=False).sum(axis=1)
    correlation = np.full(count.size, -1.0)
    correlation[usable] = together / np.sqrt((size_a * size_b)[usable])
    if not usable.any():
        return None
    lags = (np.arange(count.size) - (a.size - 1)) / RATE + other.t[0] - first.t[0]
    best = int(np.argmax(correlation))
    aside = usable & (np.abs(lags - lags[best]) > _ASIDE_S)
    near = np.abs(lags) <= DELAY_S
    return Match(
        float(lags[best]),
        float(correlation[best]),
        float(correlation[near].max(initial=-1.0)),
        float(np.sqrt(np.mean(correlation[aside] ** 2))) if aside.any() else 1.0,
    )


def _throughout(first: Signal, other: Signal, seen: Match) -> bool:
    """Return whether one half of the flight has the same lag, and none has another.

    Clocks differ all the time; the echo of a blow is not a clock.
    """
    halves = []
    for part in np.array_split(np.flatnonzero(first.known), 2):
        rows = slice(part[0], part[-1] + 1)
        half = Signal(first.t[rows], first.values[rows], first.known[rows])
        halves.append(match(half, other))
    clear = [m for m in halves if m is not None and (m.is_one_clock or m.is_other_clock)]
    return bool(clear) and all(
        m.is_other_clock and abs(m.lag - seen.lag) < 0.5 * DELAY_S for m in clear
    )


def _signal(
    series: Series, quantity: Callable[[Series, Array], Array] = beside_poses
) -> Signal | None:
    """Return the signal of a channel without outliers; None: it is too short or too long.

    `quantity` returns that (N, k) of a series, at times (N,) of an even clock.
    """
    if not series.t.size or not _SHORTEST_S <= float(series.t[-1] - series.t[0]) < _LONGEST_S:
        return None
    t = np.arange(series.t[0], series.t[-1], 1.0 / RATE)
    values = quantity(series, t)
    missing = [*gap_spans(series.t), *interpolated_spans(series.t, series.values)]
    known: Mask = np.asarray(np.isfinite(values).all(axis=1))
    known &= ~inside(t, missing) & (t <= series.t[-1])
    if not known.any():
        return None
    off = values - np.median(values[known], axis=0)
    usual = np.sqrt(
        np.mean(np.minimum(off**2, np.quantile(off[known] ** 2, 0.95, axis=0)), axis=0)
    )
    limit = _OUTLIER * usual
    return Signal(t, np.where(known[:, None], np.clip(off, -limit, limit), 0.0), known)


def _rates(turns: Series, t: Array) -> Array:
    """Return the body rates (N, 3) of usable attitudes."""
    q = unit_rows(beside_poses(turns, t))
    return body_rates(q, np.gradient(q, 1.0 / RATE, axis=0))


def _felt_force(accel: Series, t: Array) -> Array:
    """Return the size of an accelerometer's specific force (N, 1)."""
    return np.asarray(np.linalg.norm(beside_poses(accel, t), axis=1)[:, None])


def _track_force(position: Series, t: Array) -> Array:
    """Return the size of a track's specific force (N, 1)."""
    force = accelerations(position, t) + np.array([0.0, 0.0, GRAVITY])
    return np.asarray(np.linalg.norm(force, axis=1)[:, None])


def _turning(rates: Signal | None) -> Signal | None:
    """Return the acceleration about body x and y (N, 2), each over its own size."""
    if rates is None:
        return None
    values = np.gradient(rates.values[:, :2], 1.0 / RATE, axis=0)
    return rates._replace(values=_scaled(values))


def _moments(drive: Series) -> Signal | None:
    """Return the moments about body x and y that drives ask for (N, 2), each over its own size."""
    thrust = _signal(Series(drive.t, drive.values**2))
    return None if thrust is None else thrust._replace(values=_scaled(thrust.values @ _MOMENTS.T))


def _scaled(values: Array) -> Array:
    return np.asarray(values / np.maximum(values.std(axis=0), 1e-12))


def _compared(first: Signal | None, other: Signal | None) -> Match | None:
    """Return the match of two signals; None: too short, or not the same all along."""
    if first is None or other is None:
        return None
    seen = match(first, other)
    echo = seen is not None and seen.is_other_clock and not _throughout(first, other, seen)
    return None if echo else seen


def one_clock(
    flight: str, series: Mapping[str, Series]
) -> tuple[dict[str, Series], list[Finding]]:
    """Return the channels on one clock, and which ones were on another.

    The clock is that of the IMU, for the poses come from elsewhere; without an IMU that of the
    poses. Where all others agree on another clock, the IMU is moved to theirs: channels without
    motion, as the voltage, stay where they are. Where the motion shows no offset, arrival is used.
    """
    series = dict(series)
    findings = _by_arrival(flight, series)
    seen: list[tuple[list[str], Match]] = []

    def align(names: list[str], first: Signal | None, other: Signal | None) -> None:
        compared = _compared(first, other)
        if compared is not None:
            seen.append((names, compared))
            if compared.is_other_clock:
                _shift(series, names, -compared.lag)

    imu: list[str] = [name for name in ("gyro", "accel") if name in series]
    if len(imu) == 2 and not _together(series, imu):
        align(["accel"], *_pair(series, "accel"))
        imu = ["gyro"]
    if imu and "position" in series:
        poses: list[str] = [name for name in ("position", "attitude") if name in series]
        align(poses, *_pair(series, imu[0])[::-1])
    rates = _signal(series["gyro"]) if "gyro" in series else None
    if rates is None and "attitude" in series:
        rates = _signal(usable_turns(series["attitude"]), _rates)
    for name in DRIVES:
        if name in series:
            align([name], _turning(rates), _moments(series[name]))
    lags = [compared.lag for _, compared in seen if compared.is_other_clock]
    if imu and len(lags) == len(seen) > 1 and np.ptp(lags) < DELAY_S:
        lag = float(np.median(lags))
        _shift(series, [*imu, *(name for names, _ in seen for name in names)], lag)
        seen = [(imu, replace(seen[0][1], lag=-lag))]
    for names, compared in seen:
        findings += _offset_findings(flight, names, compared)
    return series, findings


def _shift(series: dict[str, Series], names: Iterable[str], seconds: float) -> None:
    """Move the stamps of channels."""
    for name in names:
        series[name] = replace(series[name], t=series[name].t + seconds)


def _pair(series: Mapping[str, Series], name: str) -> tuple[Signal | None, Signal | None]:
    """Return the same quantity from the poses and from a channel of the IMU."""
    if name == "gyro" and "attitude" in series:
        return _signal(usable_turns(series["attitude"]), _rates), _signal(series["gyro"])
    if "accel" in series:
        return _signal(series["position"], _track_force), _signal(series["accel"], _felt_force)
    return None, None


def _together(series: Mapping[str, Series], names: Iterable[str]) -> bool:
    """Return whether channels begin and end within a delay of each other."""
    ends = np.array([[series[name].t[0], series[name].t[-1]] for name in names])
    return bool((np.ptp(ends, axis=0) < DELAY_S).all())


def _offset_findings(flight: str, names: list[str], seen: Match) -> list[Finding]:
    """Report a clock that is not that of the compared channels, or one that can't be known."""
    if seen.is_one_clock:
        return []
    if not seen.is_other_clock:
        text = (
            f"{', '.join(names)}: the motion does not tell whether the stamps are of the clock of "
            "the other channels"
        )
        return [Finding("stamps", "info", flight, text, channel=names[0], key="unknown clock")]
    text = (
        f"{', '.join(names)}: stamps are {abs(seen.lag):.2f} s "
        f"{'later' if seen.lag > 0.0 else 'earlier'} than those of the other channels for the "
        "same motion: another clock; corrected by that"
    )
    return [
        Finding("stamps", "warning", flight, text, channel=names[0], key="other clock",
                numbers=(seen.lag,))
    ]  # fmt: skip


def _by_arrival(flight: str, series: dict[str, Series]) -> list[Finding]:
    """Report stamps that are later than the arrival of their messages: no sample is from then.

    Those that are far off are put where the arrival of the other channels has them.
    """
    late = {
        name: float(np.nanmedian(s.arrival - s.t))
        for name, s in series.items()
        if s.arrival is not None and np.isfinite(s.arrival - s.t).any()
    }
    usual = float(np.median([x for x in late.values() if x >= -_AHEAD_S] or [0.0]))
    ahead: dict[float, list[str]] = {}
    for name, latency in late.items():
        if latency < -_AHEAD_S:
            ahead.setdefault(round(latency, 4), []).append(name)
    findings = []
    for latency, names in ahead.items():
        text = (
            f"{', '.join(names)}: stamps are {-latency:.3g} s later than the arrival of the "
            "messages; expected: earlier, by the latency; another clock"
        )
        if usual - latency > DELAY_S:
            _shift(series, names, latency - usual)
            text += "; corrected by the times of arrival"
        findings.append(
            Finding("stamps", "warning", flight, text, channel=names[0], key="ahead of arrival",
                    numbers=(latency,))
        )  # fmt: skip
    return findings

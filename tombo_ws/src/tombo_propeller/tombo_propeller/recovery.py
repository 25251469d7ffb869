"""Collisions in a thrust or speed trace, and how long each takes to recover.

A collision is a drop of a quarter or more of the level before it. Recovered means back at 90 % of
that level, as Table III's recovery time is read, however deep the drop was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError

SHARE = 0.9
"""Share of the level before the collision."""
_LOSS = 0.25
"""Share of the level that has to be lost."""
_NOISES = 5.0
"""Standard deviations of noise that a drop must have."""
_BEFORE = 0.3
"""s before a collision that give the level."""
_LEAST_BEFORE = 12
_LEAST = 40
_LEAST_SAMPLES = 12
_CURVED = 0.006
"""Share of the recovery time by which the fit misses the passage (simulated strikes)."""
_SMOOTH = 0.02
"""s over which a drop is looked for at most."""


@dataclass(frozen=True)
class ThrustRecovery:
    """One collision. Times in s."""

    time: float
    """When the drop begins."""
    level: float
    """Before it, in the trace's unit."""
    lowest: float
    """Smallest value, noise smoothed."""
    recovered: float
    """Time from the drop's beginning until 90 % are back; NaN if they aren't."""
    low: float
    high: float
    """Ends of its 95 % interval; `high` is infinite where the trace ends too early."""
    why: str
    """What keeps it from being a number; empty if it is one."""

    def as_text(self, *, lower_bound: bool = False) -> str:
        """Say it with its interval; of a lower bound, as of a speed's recovery, "at least"."""
        if self.why:
            return f"more than {self.low:.3f} s: {self.why}"
        least = "at least " if lower_bound else ""
        return f"{least}{self.recovered:.3f} s ({self.low:.3f} to {self.high:.3f})"


def recoveries(time: Array, value: Array, share: float = SHARE) -> tuple[ThrustRecovery, ...]:
    """Find the collisions in a trace and the time each takes to recover.

    Args:
        time: s, rising, (n,).
        value: thrust or speed, positive before a collision, (n,).
        share: of the level before, that counts as recovered.

    Raises:
        InputError: too short, not rising, no positive level, or no collision.
    """
    time, value, step = _checked(time, value)
    noise = _noise(value)
    drops = _drops(value, step, noise)
    usual = float(np.median(value))
    if not drops and usual < -_NOISES * noise:
        raise InputError(
            f"a level of {usual:.3g}, is the sensor's sign reversed, or the tare too large?; "
            "accepted: thrust or speed that is positive before a collision"
        )
    if not drops:
        raise InputError(
            f"no collision in {time[-1] - time[0]:.2f} s: no drop by {100 * _LOSS:.0f} % and "
            f"{_NOISES:g} times the noise of {noise:.3g}; accepted: a trace with one"
        )
    ends = [*(k for k, _ in drops[1:]), len(value)]
    return tuple(
        _recovery(time, value, step, noise, k, end, share, level)
        for (k, level), end in zip(drops, ends, strict=True)
    )


def _checked(time: Array, value: Array) -> tuple[Array, Array, float]:
    known = np.isfinite(time) & np.isfinite(value)
    time, value = np.asarray(time, float)[known], np.asarray(value, float)[known]
    if len(time) < _LEAST:
        raise InputError(f"{len(time)} samples of the trace; accepted: {_LEAST} or more")
    steps = np.diff(time)
    if not (steps > 0.0).all():
        k = int(np.argmin(steps > 0.0))
        raise InputError(f"time does not rise at {time[k]:g} s; accepted: rising times [s]")
    step = float(np.median(steps))
    if step > 0.05:
        raise InputError(
            f"a sample each {step:.3g} s; accepted: 20 a second or more (is the time in seconds?)"
        )
    if steps.max() > 20.0 * step and steps.max() > 0.05:
        k = int(np.argmax(steps))
        raise InputError(
            f"a gap of {steps[k]:.3g} s at {time[k]:g} s; accepted: a trace without gaps"
        )
    even = np.arange(time[0], time[-1], step)
    return even, np.interp(even, time, value), step


def _noise(value: Array) -> float:
    """Return the standard deviation of white noise, from neighbours' differences."""
    second = value[2:] - 2.0 * value[1:-1] + value[:-2]
    return float(1.4826 * np.median(np.abs(second - np.median(second)))) / math.sqrt(6.0)


def _smooth(value: Array, n: int) -> Array:
    if n < 2:
        return value
    padded = np.concatenate([np.full(n // 2, value[0]), value, np.full(n - 1 - n // 2, value[-1])])
    return np.convolve(padded, np.full(n, 1.0 / n), "valid")


def _drops(value: Array, step: float, noise: float) -> list[tuple[int, float]]:
    """Return where drops begin, and the level that each time is to come back.

    After a drop the trace is recovering until it is near its level again; a further drop in that
    time is a collision, too. Recovery is the return to the level before the first.
    """
    n = max(1, round(_SMOOTH / step))
    before = max(_LEAST_BEFORE, round(_BEFORE / step))
    smooth = _smooth(value, n)
    drops: list[tuple[int, float]] = []
    recovering, risen, lowest, level, since = False, False, math.inf, 0.0, 0
    for k in range(before, len(value), max(1, n // 4)):
        if not recovering and k - since >= before // 2:
            level = float(np.median(value[max(since, k - before) : k - n]))
        least = max(_LOSS * abs(level), _NOISES * noise / math.sqrt(n))
        top, begin = level, max(k - 2 * n, 1)
        if recovering:
            lowest = min(lowest, float(smooth[k]))
            risen = risen or smooth[k] > lowest + least
            latest = smooth[max(k - 3 * n, 0) : k]
            top = float(latest.max()) if risen else -math.inf
            begin = max(k - 3 * n, 0) + int(np.argmax(latest))
        if level > 0.0 and top - smooth[k] > least:
            start = _begin(value[: k + 2 * n], begin, k, top, noise)
            if not drops or start > drops[-1][0]:  # else it is the same drop, seen again
                drops.append((start, level))
            recovering, risen, lowest = True, False, math.inf
        elif recovering and smooth[k] > level - 0.4 * least:
            recovering, since = False, k
    return drops


def _begin(value: Array, first: int, k: int, top: float, noise: float) -> int:
    """Return where the drop seen at `k` begins: from `first` on, three samples that are below."""
    below = value < top - max(3.0 * noise, 0.03 * abs(top))
    starts = np.flatnonzero(below[first:-2] & below[first + 1 : -1] & below[first + 2 :])
    return first + int(starts[0]) if len(starts) else k


def _recovery(
    time: Array,
    value: Array,
    step: float,
    noise: float,
    k: int,
    end: int,
    share: float,
    level: float,
) -> ThrustRecovery:
    before = max(round(_BEFORE / step), _LEAST_BEFORE)
    # The level's own error: noise, and that a stand drifts from one part of the time to the next.
    steady = value[max(k - before, 0) : k]
    level_sd = noise / math.sqrt(before)
    if len(steady) > 8 and abs(float(np.median(steady)) - level) < 0.1 * level:
        level = float(np.mean(steady))
        level_sd = math.hypot(
            level_sd, float(np.std([p.mean() for p in np.array_split(steady, 4)])) / 2
        )
    after = value[k:end]
    span = time[k:end] - time[k]
    lowest = float(_smooth(after, max(1, round(0.005 / step))).min())
    crossing = _crossing(span, after, share * level, lowest, noise)
    if crossing is None:
        cut = "another collision comes first" if end < len(value) else "the trace ends before"
        if end == len(value) and len(after) * step > 2.0:
            cut = f"{share:.0%} are never back"
        return ThrustRecovery(
            float(time[k]), level, lowest, math.nan, float(span[-1]), math.inf, cut
        )
    middle, slope, sd = crossing
    error = math.hypot(sd, share * level_sd / max(slope, 1e-12))
    error = math.hypot(error, 0.5 * step, _CURVED * middle)
    return ThrustRecovery(
        float(time[k]), level, lowest, middle, max(middle - 1.96 * error, 0.0),
        middle + 1.96 * error, "",
    )  # fmt: skip


def _crossing(
    span: Array, after: Array, goal: float, lowest: float, noise: float
) -> tuple[float, float, float] | None:
    """Return when the recovering trace passes `goal` [s], its slope there, and the time's error.

    An exponential approach is fitted to the upper part of the recovery, as far beyond the passage
    as before it; (1 - fold)^3 is one in the end.
    """
    smooth = _smooth(after, max(3, len(after) // 60 | 1))
    bottom = int(np.argmin(smooth))
    up = np.flatnonzero(smooth[bottom:] >= goal)
    if not len(up):
        return None
    at = bottom + int(up[0])
    first = at
    while first > bottom and smooth[first - 1] > lowest + 0.5 * (goal - lowest):
        first -= 1
    last = min(at + max(at - first, 3), len(after) - 1)
    t, v = span[first : last + 1], after[first : last + 1]
    if len(t) < _LEAST_SAMPLES:
        before = max(at - 1, 0)
        rise = max(float(after[at] - after[before]), 1e-9) / max(
            float(span[at] - span[before]), 1e-9
        )
        return float(span[at]), rise, noise / rise + float(span[at] - span[before])
    origin, length = float(span[at]), float(t[-1] - t[0])
    rate, top, size, _ = min(
        (_approach((t - origin) / length, v, float(k)) for k in np.geomspace(0.05, 12.0, 60)),
        key=lambda fit: fit[3],
    )
    u = (t - origin) / length
    decay = np.exp(-rate * u)
    matrix = np.column_stack([np.ones_like(u), decay, -size * u * decay])
    left = v - top - size * decay
    spread = math.hypot(float(np.sqrt(np.sum(left**2) / max(len(t) - 3, 1))), 1e-12)
    inside = (goal - top) / size if size else -1.0
    if size >= 0.0 or inside <= 0.0:
        return origin, 1e-9, length
    root = -math.log(inside) / rate
    slope = -size * rate * inside / length
    if not u[0] <= root <= u[-1]:
        return origin, slope, length
    row = np.array([1.0, inside, -size * root * inside])
    share = float(row @ np.linalg.pinv(matrix.T @ matrix) @ row)
    return origin + root * length, slope, max(spread, noise) * math.sqrt(share) / slope


def _approach(u: Array, v: Array, rate: float) -> tuple[float, float, float, float]:
    """Fit level and size of an exponential approach of a given rate; return the misfit, too."""
    matrix = np.column_stack([np.ones_like(u), np.exp(-rate * u)])
    (top, size), *_ = np.linalg.lstsq(matrix, v, rcond=None)
    left = v - top - size * matrix[:, 1]
    return rate, float(top), float(size), float(left @ left)

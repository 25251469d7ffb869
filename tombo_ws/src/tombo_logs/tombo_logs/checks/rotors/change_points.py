"""Whether the vehicle itself changes within a flight: a load dropped, a propeller chipped.

Thrust per command is watched. Batteries and manoeuvres move it slowly; a step is a change point,
and one set of parameters can't be right on both sides of it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tombo_bag.flight import Finding
from tombo_dynamics.arrays import Array

_BIN_S = 0.25
_SIDE = 8
"""Bins on either side that are compared."""
_FAR = 4 * _SIDE
"""Bins on either side over which a step must last."""
_STEP = 0.06
"""Share by which thrust per command steps."""
_SIGMAS = 6.0
_PENALTY = 12.0
"""Of a change point, in variances of a bin's noise times the logarithm of their number."""


def find_steps(t: Array, ratio: Array) -> list[tuple[float, float]]:
    """Return times [s] and relative sizes of the steps of a positive ratio (N,) at times (N,)."""
    if t.size < 4 * _SIDE:
        return []
    bins = np.floor((t - t[0]) / _BIN_S).astype(np.int64)
    used, first = np.unique(bins, return_index=True)
    edges = [*first.tolist(), t.size]
    middles = np.array([np.median(ratio[b:e]) for b, e in pairwise(edges)])
    middles = np.log(np.maximum(middles, 1e-12))
    if used.size < 2 * _SIDE + 2:
        return []
    noise = 1.4826 * float(np.median(np.abs(np.diff(middles)))) / np.sqrt(2.0)
    steps = []
    for at in _change_points(middles / max(noise, 1e-6)):
        if used[min(at + _SIDE, used.size) - 1] - used[max(at - _SIDE, 0)] > 3 * _SIDE:
            continue  # the samples between were excluded
        before, after = middles[max(at - _SIDE, 0) : at], middles[at : at + _SIDE]
        if min(before.size, after.size) < _SIDE:
            continue  # too near to take-off or landing
        step = float(np.median(after) - np.median(before))
        spread = float(np.sqrt((np.var(before) + np.var(after)) / 2.0 / _SIDE)) + noise / 3.0
        if abs(step) > max(_STEP, _SIGMAS * spread) and _lasts(middles, at, step):
            steps.append((float(t[0] + used[at] * _BIN_S), float(np.expm1(step))))
    return steps


def changes(flight: str, t: Array, force: Array, drive: Array) -> list[Finding]:
    """Report where thrust per command steps, at times t (N,) in flight [s].

    `force` (N,) is specific force along the rotors' axis [m/s^2], `drive` (N,) the mean square of
    speeds or commands.
    """
    usable = (drive > 0.05 * np.median(drive)) & (force > 2.0) if drive.size else drive > 0.0
    findings = []
    for at, step in find_steps(t[usable], force[usable] / drive[usable]):
        text = (
            f"from {at:.1f} s on a command gives {100 * abs(step):.0f} % "
            f"{'more' if step > 0.0 else 'less'} specific force than before: the vehicle changed "
            "(load, propeller, battery?); diagnose the two parts as two flights"
        )
        findings.append(Finding("change", "warning", flight, text, at, at, "accel"))
    return findings


def _change_points(values: Array) -> list[int]:
    import ruptures  # slow to load, and most logs have no commands

    penalty = _PENALTY * np.log(values.size)
    search = ruptures.Binseg(model="l2", min_size=_SIDE // 2, jump=1).fit(values[:, None])
    return [int(i) for i in search.predict(pen=penalty)[:-1]]


def _lasts(middles: Array, at: int, step: float) -> bool:
    """Return whether the step lasts: the effect of a manoeuvre does not."""
    before, after = middles[max(at - _FAR, 0) : at], middles[at : at + _FAR]
    apart = float(np.median(after) - np.median(before)) / step
    spreads = [float(np.subtract(*np.percentile(side, [85.0, 15.0]))) for side in (before, after)]
    return apart > 0.7 and max(spreads) < 0.8 * abs(step)

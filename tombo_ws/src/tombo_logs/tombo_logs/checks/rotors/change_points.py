"""Whether the vehicle itself changes within a flight: a load dropped, a propeller chipped.

Thrust per command is compared before and after each moment. Batteries and manoeuvres move it
slowly; a lasting step is a change, and one set of parameters can't be right on both sides of it.
"""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Finding
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import runs

_BIN_S = 0.25
_SIDE = 8
"""Bins on either side that are compared."""
_LASTING = 4 * _SIDE
"""Bins on either side over which a step must last."""
_STEP = 0.06
"""Share by which thrust per command steps."""
_SIGMAS = 6.0


def find_steps(t: Array, ratio: Array) -> list[tuple[float, float]]:
    """Return times [s] and relative sizes of the steps of a positive ratio (N,) at times (N,)."""
    if not t.size:
        return []
    bins = np.floor((t - t[0]) / _BIN_S).astype(np.int64)
    used, first = np.unique(bins, return_index=True)
    parts = np.split(ratio, first[1:])
    middles = np.log(np.maximum([float(np.median(part)) for part in parts], 1e-12))
    if used.size < 2 * _SIDE + 2:
        return []
    noise = 1.4826 * float(np.median(np.abs(np.diff(middles)))) / np.sqrt(2.0)
    sides = np.lib.stride_tricks.sliding_window_view(middles, _SIDE)
    before, after = sides[:-_SIDE], sides[_SIDE:]
    step = after.mean(axis=1) - before.mean(axis=1)
    spread = np.sqrt((before.var(axis=1) + after.var(axis=1)) / 2.0 / _SIDE) + noise / 3.0
    # else samples between were excluded
    near = used[2 * _SIDE - 1 :] - used[: 1 - 2 * _SIDE] <= 3 * _SIDE
    clear = near & (np.abs(step) > np.maximum(_STEP, _SIGMAS * spread))
    peaks = [b + int(np.argmax(np.abs(step[b:e]))) for b, e in runs(clear)]
    return [
        (float(t[0] + used[k + _SIDE] * _BIN_S), float(np.expm1(step[k])))
        for k in peaks
        if _lasts(middles, k + _SIDE, float(step[k]))
    ]


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


def _lasts(middles: Array, at: int, step: float) -> bool:
    """Return whether the step lasts: the effect of a manoeuvre does not."""
    before, after = middles[max(at - _LASTING, 0) : at], middles[at : at + _LASTING]
    apart = float(np.median(after) - np.median(before)) / step
    spreads = [float(np.subtract(*np.percentile(side, [85.0, 15.0]))) for side in (before, after)]
    return apart > 0.7 and max(spreads) < 0.8 * abs(step)

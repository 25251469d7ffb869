"""Where the vehicle stands on the ground: before take-off, after landing, and between."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import Mask, Span, merged, runs, sample_interval, white_noise

_RISE = 0.12
"""m that a flight goes above the ground, at least."""
_GROUND_BAND_M = 0.03
"""m above where it stands: no longer on the ground."""
_STILL = 0.03
"""m/s below which a vehicle stands."""
_WINDOW_S = 0.4
_MARGIN_S = 0.2
"""s after lift-off and before touch-down that are excluded as well."""
_LANDING = 1.0
"""m/s: a landing is slower, a fall is faster."""
_FALL_S = 0.3
_DRIVERS = ("rotor_command", "motor_command", "rotor_speed")
"""Commands first: sensors fail more often."""
_OFF, _IDLE = 0.2, 0.8
"""Speed or command over that in flight below which motors are off, and below which they idle."""
_PART_IDLE = 0.3
"""Share of the time on the ground for which motors idle or are off."""
_NO_DRIVE = {"rotor_speed": 10.0, "rotor_command": 10.0, "motor_command": 0.01}
"""Value below which no rotor flies, in the unit of the channel."""
CUT_BEFORE_TAKE_OFF = "is the log cut before take-off? Accepted: a log with seconds of flight"


def rises(position: Series) -> bool:
    """Return whether a track leaves the height that it has most of the time."""
    return float(np.ptp(np.percentile(position.values[:, 2], [1.0, 99.0]))) > _RISE


def check_flies(flight: str, position: Series, series: Mapping[str, Series]) -> None:
    """Refuse a log in which the vehicle stands with its motors off.

    Raises:
        RefusedLog: says so.
    """
    if position.t[-1] - position.t[0] < 2.0 * _WINDOW_S:
        return
    drives = [name for name in DRIVES if name in series]
    off = all(float(np.percentile(series[n].values, 99.0)) < _NO_DRIVE[n] for n in drives)
    if drives and off and not rises(position):
        raise RefusedLog(
            flight,
            drives[0],
            f"it does not fly: z stays where it is, and the motors are off "
            f"({', '.join(drives)}); {CUT_BEFORE_TAKE_OFF}",
        )


def ground_spans(position: Series, series: Mapping[str, Series]) -> list[Span]:
    """Return the spans on the ground; none where it can't be told from hovering.

    It stands where it is still and as low as anywhere in the flight, and rises later or came down
    before. Where speeds or commands of the motors are known, they must be below those of hover
    for a part of that time: a hover is still and low, too.
    """
    t, z = position.t, position.values[:, 2]
    if t.size < 10 or t[-1] - t[0] < 2.0 * _WINDOW_S:
        return []
    still = _still(t, position.values)
    drive = motor_drive(t, series)
    off = drive < _OFF
    floor = float(z.min())
    if (off & still).any():
        floor = max(floor, float(z[off & still].max()))  # of the highest place where it stood
    spans = []
    top = float(np.percentile(z, 90.0))
    for begin, end in runs(still | off):
        # from where it stands on, so long as it stays low: lift-off is slow at first
        level = float(np.median(z[begin:end]))
        if top - level < _RISE or level > floor + _GROUND_BAND_M + _RISE:
            continue
        known = drive[begin:end][np.isfinite(drive[begin:end])]
        if known.size:
            # idling before take-off is below hover for a while; nothing is said before arming
            standing = bool((known < _IDLE).mean() > _PART_IDLE)
        else:
            standing = _is_still(t[begin:end], position.values[begin:end])
        if not standing:
            continue
        low = z < level + _GROUND_BAND_M
        first, last = begin, end - 1
        while first > 0 and low[first - 1]:
            first -= 1
        while last < t.size - 1 and low[last + 1]:
            last += 1
        spans.append((_touch_down(t, z, first, level, top), float(t[last]) + _MARGIN_S))
    if spans and z[-1] < floor + _GROUND_BAND_M < z.max() and t[-1] > spans[-1][1]:
        # the log ends before it stands still
        last = int(np.flatnonzero(z >= floor + _GROUND_BAND_M)[-1]) + 1
        touched = _touch_down(t, z, last, floor, top)
        fall = np.interp(touched - _FALL_S, t, z) - np.interp(touched, t, z)
        if fall < _LANDING * _FALL_S:  # else it fell: a crash
            spans.append((touched, float(t[-1])))
    spans = merged([*spans, *_off_spans(t, off & (z < floor + _RISE))])
    return [(t[0] if b < t[0] + 0.5 else b, t[-1] if e > t[-1] - 0.5 else e) for b, e in spans]


def ground(flight: str, position: Series, series: Mapping[str, Series]) -> list[Finding]:
    """Report where the vehicle stands on the ground."""
    return [
        Finding("ground", "info", flight, "on the ground or landing: set apart", b, e, "position")
        for b, e in ground_spans(position, series)
    ]


def _still(t: Array, position: Array) -> Mask:
    """Return where the mean velocity over a window is next to nothing."""
    half = max(round(0.5 * _WINDOW_S / max(sample_interval(t), 1e-6)), 1)
    ahead = np.minimum(np.arange(t.size) + half, t.size - 1)
    behind = np.maximum(np.arange(t.size) - half, 0)
    held = np.maximum(t[ahead] - t[behind], 1e-9)
    speed = np.linalg.norm(position[ahead] - position[behind], axis=1) / held
    return np.asarray(speed < _STILL)


def _is_still(t: Array, position: Array) -> bool:
    """Return whether it moves no more than white noise does: a hovering vehicle wanders."""
    if t.size < 6 or t[-1] - t[0] < _WINDOW_S:
        return False
    noise = white_noise(position)
    wander = 1.4826 * np.median(np.abs(position - np.median(position, axis=0)), axis=0)
    return bool((wander <= np.maximum(2.5 * noise, 1.5e-3)).all())


def motor_drive(t: Array, series: Mapping[str, Series]) -> Array:
    """Return the motors' mean speed or command over that in flight; NaN: not known."""
    for name in _DRIVERS:
        drive = series.get(name)
        if drive is None or drive.t.size < 10:
            continue
        mean = drive.values.mean(axis=1)
        usual = float(np.percentile(mean, 75.0))
        if usual > 0.0:
            at = np.interp(t, drive.t, mean) / usual
            outside = (t < drive.t[0] - 0.1) | (t > drive.t[-1] + 0.1)
            return np.where(outside, np.nan, at)
    return np.full(t.shape, np.nan)


def _off_spans(t: Array, off: Mask) -> list[Span]:
    return [
        (float(t[b]) - _MARGIN_S, float(t[e - 1]) + _MARGIN_S)
        for b, e in runs(off)
        if t[e - 1] - t[b] > 0.05
    ]


def _touch_down(t: Array, z: Array, first: int, level: float, top: float) -> float:
    """Return when a descent first touched the ground: it may hop after that."""
    high = np.flatnonzero(z[:first] > level + 0.5 * (top - level))
    begin = int(high[-1]) if high.size else first
    low = np.flatnonzero(z[begin : first + 1] < level + _GROUND_BAND_M + 0.02)
    touched = begin + int(low[0]) if low.size else first
    # it may have happened at any time since the pose before
    return float(t[max(touched - 1, 0)]) - (_MARGIN_S if touched > 0 else 0.0)

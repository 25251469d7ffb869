"""Sudden events of a flight, and whether they are crashes, contacts or errors of the poses.

Events are jumps of readings, velocities and rates, and large tilt. A contact is excluded with the
recovery from it; the rest after a crash, to the end.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.clocks.stamps import jitter
from tombo_logs.checks.even_flight import POSE_WIDTH
from tombo_logs.checks.spans import Span, block_means, inside, merged, runs, sample_interval
from tombo_logs.readers.frames import is_usable

_SPIKE = 1.5 * GRAVITY
"""m/s^2 by which the accelerometer differs from its readings around that time."""
_LIMIT = 2.5 * GRAVITY
"""m/s^2 that the accelerometer reads where the poses show no such acceleration."""
_JUMP = 0.4
"""m/s that the track's velocity changes within two or three poses."""
_THROWN = 3.0
"""m/s"""
_TURN = 3.0
"""rad/s that the rate changes within two or three poses."""
_TILT = np.radians(75.0)
_WINDOW_S = 0.06
_BEFORE_S = 0.25
"""s excluded before an event."""
_RECOVERY_S = 2.0
"""s after a contact that are the vehicle's recovery."""
_FALL_S = 3.0
"""An event is a crash if the vehicle is on the ground within this time [s]."""
_CONFIRMED_S = 0.15
"""s within which the gyro confirms a turn."""
_TURN_ALONE = 5.0
"""rad/s from which on a jump of the rate is an error where no gyro could deny it."""
_JUMP_S = 0.3
"""s around a jump of the poses alone that are excluded."""


@dataclass(frozen=True)
class Event:
    """A sudden event."""

    t: float
    text: str
    channel: str
    kind: str
    """accel (a spike), gyro (a jump), track (its velocity jumps), leap (more than anything that
    flies could), turn (the attitude's rate jumps) or lean."""
    size: float = 0.0
    """Size of the event, in its own unit."""


def accel_events(accel: Series, p_t: Array, p_acceleration: Array) -> list[Event]:
    """Return when the accelerometer reads what the flight does not explain.

    `p_acceleration` (M,) is the size of the specific force that the poses tell [m/s^2], at `p_t`.
    """
    step = sample_interval(accel.t)
    if accel.t.size < 20 or step == 0.0:
        return []
    every = max(round(0.01 / step), 1)
    t, a = block_means(accel.t, every), block_means(accel.values, every)
    width = 2 * round(0.2 / (step * every)) + 1
    usual = median_filter(a, (width, 1), mode="nearest")
    spike = np.linalg.norm(a - usual, axis=1)
    # smoothed as the track is: a short push is in both, but not at the same height
    size = np.linalg.norm(gaussian_filter1d(a, POSE_WIDTH / (step * every), axis=0), axis=1)
    seen = np.interp(t, p_t, p_acceleration) if p_t.size else np.full(t.size, GRAVITY)
    events = []
    for begin, _ in runs(spike > _SPIKE):
        text = f"accel leaves the readings around it by {spike[begin]:.0f} m/s^2"
        events.append(Event(float(t[begin]), text, "accel", "accel"))
    for begin, end in runs((size > _LIMIT) & (seen < _LIMIT - GRAVITY)):
        if (spike[begin:end] < _SPIKE).all():
            text = (
                f"accel exceeds {size[begin] / GRAVITY:.1f} g where the track has "
                f"{seen[begin] / GRAVITY:.1f} g"
            )
            events.append(Event(float(t[begin]), text, "accel", "accel"))
    return events


def pose_events(position: Series, attitude: Series | None) -> list[Event]:
    """Return when velocity or body rates jump within two or three poses."""
    events = []
    stamps = _evened(position.t)
    t, change, noise = _slope_changes(stamps, position.values)
    # nothing that flies is thrown back much faster than it came
    fastest = max(_THROWN, 3.0 * _fast(stamps, position.values))
    limit = max(_JUMP, 8.0 * noise)
    if jitter(position.t) > 0.3 * sample_interval(position.t):
        limit = fastest  # stamps so uneven make jumps of their own
    for at, size in _peaks(t, change, limit):
        kind = "track" if size < fastest else "leap"
        events.append(Event(at, f"the track's velocity jumps by {size:.2f} m/s", "position", kind))
    if attitude is None:
        return events
    usable = is_usable(attitude.values)
    if np.count_nonzero(usable) > 10:
        turns = Rotation.from_quat(attitude.values[usable])
        steps = np.zeros((len(turns), 3))
        steps[1:] = (turns[:-1].inv() * turns[1:]).as_rotvec()
        stamps = _evened(attitude.t[usable])
        t, change, noise = _slope_changes(stamps, np.cumsum(steps, axis=0))
        for at, size in _peaks(t, change, max(_TURN, 8.0 * noise)):
            text = f"the body's rate jumps by {size:.1f} rad/s"
            events.append(Event(at, text, "attitude", "turn", size))
    return events


def gyro_events(gyro: Series) -> list[Event]:
    """Return when the gyro jumps."""
    every = max(round(0.01 / max(sample_interval(gyro.t), 1e-6)), 1)
    angle = cumulative_trapezoid(gyro.values, gyro.t, axis=0, initial=0.0)
    t, change, noise = _slope_changes(gyro.t[::every], angle[::every])
    return [
        Event(at, f"the gyro jumps by {size:.1f} rad/s", "gyro", "gyro")
        for at, size in _peaks(t, change, max(_TURN, 8.0 * noise))
    ]


def _peaks(t: Array, change: Array, limit: float) -> list[tuple[float, float]]:
    """Return time and size of the largest change in each run above a limit."""
    peaks = [b + int(np.argmax(change[b:e])) for b, e in runs(change > limit)]
    return [(float(t[k]), float(change[k])) for k in peaks]


def tilt_events(attitude: Series) -> list[Event]:
    """Return when the vehicle leans so far that its rotors can't hold it."""
    usable = is_usable(attitude.values)
    if not usable.any():
        return []
    lean = tilt_of(attitude.values[usable])
    t = attitude.t[usable]
    return [
        Event(float(t[b]), f"leans by more than {np.degrees(_TILT):.0f} deg", "attitude", "lean")
        for b, e in runs(lean > _TILT)
        if t[e - 1] - t[b] > 0.05
    ]


def tilt_of(q: Array) -> Array:
    """Return angles between body z and map z [rad] of (N, 4) quaternions."""
    up = Rotation.from_quat(q).apply([0.0, 0.0, 1.0])[:, 2]
    return np.asarray(np.arccos(np.clip(up, -1.0, 1.0)))


def _evened(t: Array) -> Array:
    """Return stamps on an even grid where they jitter: differences over them would, too."""
    step = sample_interval(t)
    if step == 0.0 or jitter(t) < 0.05 * step:
        return t
    counts = np.maximum(np.round(np.diff(t) / step), 1.0)
    return np.asarray(t[0] + step * np.concatenate([[0.0], np.cumsum(counts)]))


def _fast(t: Array, position: Array) -> float:
    """Return the speed that the track seldom exceeds [m/s]."""
    lag = max(round(0.1 / max(sample_interval(t), 1e-6)), 1)
    if t.size <= lag:
        return 0.0
    speed = np.linalg.norm(position[lag:] - position[:-lag], axis=1) / (t[lag:] - t[:-lag])
    return float(np.percentile(speed, 95.0))


def _slope_changes(t: Array, values: Array) -> tuple[Array, Array, float]:
    """Return times, how much the slope changes there against its usual change, and the noise."""
    step = sample_interval(t)
    count = max(int(np.ceil(_WINDOW_S / step)), 2) if step > 0.0 else 0
    if count == 0 or t.size < 4 * count + 2:
        return np.zeros(0), np.zeros(0), 0.0
    index = np.arange(count, t.size - count)
    window = np.arange(count + 1)
    behind = _slopes(t, values, index[:, None] - window[None, :])
    ahead = _slopes(t, values, index[:, None] + window[None, :])
    change = ahead - behind
    width = 2 * round(0.25 / step) + 1
    change -= median_filter(change, (width, 1), mode="nearest")
    # next to a gap the slopes are of different times
    near = (t[index + count] - t[index - count]) < 2.6 * count * step
    size = np.where(near, np.linalg.norm(change, axis=1), 0.0)
    noise = float(1.4826 * np.median(size))
    return t[index], size, noise


def _slopes(t: Array, values: Array, rows: Array) -> Array:
    """Return (N, k): slopes of straight lines through the samples of each row."""
    tau = t[rows] - t[rows].mean(axis=1, keepdims=True)
    weights = tau / np.sum(tau**2, axis=1, keepdims=True)
    return np.asarray(np.einsum("nw,nwk->nk", weights, values[rows]))


def impacts(
    flight: str, events: list[Event], ground: list[Span], flown: Span, channels: Collection[str]
) -> list[Finding]:
    """Distinguish crashes, contacts and jumps of the motion capture; exclude the affected spans.

    Args:
        flight: name.
        events: sudden changes, in any order.
        ground: spans on the ground; what happens there is take-off and landing.
        flown: begin and end of the flight [s].
        channels: those of the flight: what only poses show though an acceleration or a gyro are
            there is an error of the poses, and what only turns is a manoeuvre.
    """
    begin, end = flown
    times = np.array([e.t for e in events])
    inflight = [e for e, down in zip(events, inside(times, ground), strict=True) if not down]
    findings = []
    for first, last in merged([(e.t, e.t) for e in inflight], apart=_RECOVERY_S):
        members = sorted((e for e in inflight if first <= e.t <= last), key=lambda e: e.t)
        kinds = {e.kind for e in members}
        # positions without an attitude are an estimator's: they jump where it is corrected
        by_track = "attitude" in channels and not {"accel", "acceleration"} & set(channels)
        hit = "lean" in kinds or ("track" if by_track else "accel") in kinds
        if not hit:
            findings += _pose_jumps(flight, members, "gyro" in channels)
            continue
        downed = any(b > begin and first < b <= last + _FALL_S and e >= end for b, e in ground)
        downed |= end - last < (_FALL_S if "lean" in kinds else 0.5)
        if downed:
            check, text, until = "crash", "a crash; set apart to the end", end
        else:
            check, text = "contact", "a contact, set apart with the recovery from it"
            until = min(last + _RECOVERY_S, end)
        message = f"at {first:.2f} s {_described(members)}: {text}"
        span = max(first - _BEFORE_S, begin), until
        findings.append(Finding(check, "fault", flight, message, *span, members[0].channel))
    return findings


def _pose_jumps(flight: str, members: list[Event], has_gyro: bool) -> list[Finding]:
    """Report where poses jump, but for turns that the gyro confirms."""
    turns = [e.t for e in members if e.kind == "gyro"]
    least = 0.0 if has_gyro else _TURN_ALONE
    jumps = [
        e
        for e in members
        if e.kind in ("track", "leap")
        or (
            e.kind == "turn"
            and e.size > least
            and not any(abs(e.t - t) < _CONFIRMED_S for t in turns)
        )
    ]
    findings = []
    for first, last in merged([(e.t, e.t) for e in jumps], apart=2.0 * _JUMP_S):
        there = [e for e in jumps if first <= e.t <= last]
        why = "the IMU does not" if has_gyro else "the track goes on"
        text = f"at {first:.2f} s {_described(there)}, {why}: markers swapped? Set apart"
        span = first - _JUMP_S, last + _JUMP_S
        findings.append(Finding("jump", "warning", flight, text, *span, there[0].channel))
    return findings


def _described(members: list[Event]) -> str:
    texts = list(dict.fromkeys(e.text for e in members))
    return ", ".join(texts[:3]) + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")


def unmeasured(flight: str, events: list[Event], lines: list[Finding]) -> list[Finding]:
    """Report when readings look like a crash on a line that was drawn, not measured.

    `lines` are straight lines of gyro or accelerometer, already excluded; `events` lie on them.
    """
    findings = []
    for line in lines:
        on = [e for e in events if e.channel == line.channel and line.start_s <= e.t <= line.end_s]
        if on:
            first = min(on, key=lambda e: e.t)
            text = (
                f"at {first.t:.2f} s {first.text}, as in a crash; but from {line.start_s:.2f} s "
                f"on {line.channel} is a straight line and no measurement: what crashed is the "
                "log, the poses go on; set apart"
            )
            span = max(line.start_s - _BEFORE_S, 0.0), line.end_s
            findings.append(Finding("crash", "fault", flight, text, *span, first.channel))
    return findings

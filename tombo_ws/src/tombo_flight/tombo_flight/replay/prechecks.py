"""Checks of a recording's poses before a replay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_flight.replay.recorded import PoseTrack

_UNIT = 1e-3
_AHEAD_S, _BEHIND_S = 0.002, 0.25
_DRIFT_S = 0.02
_JUMP_S = 0.25
_FAR_M = 100.0


def check_poses(poses: PoseTrack, gap_max_s: float) -> list[str]:
    """Return the findings on a track of poses; `gap_max_s` as in the detector's parameters."""
    if not len(poses.stamp_ns):
        return []
    values = np.concatenate([poses.position, poses.attitude], axis=1)
    sound: NDArray[np.bool_] = np.isfinite(values).all(axis=1)
    norms = np.linalg.norm(poses.attitude, axis=1)
    return [
        *_bodies(poses),
        *_frames(poses),
        *_numbers(poses, sound, norms),
        *_stamps(poses),
        *_clock(poses),
        *_gaps(poses, gap_max_s),
    ]


def latency_s(poses: PoseTrack) -> Array:
    """Return arrival minus stamp of each pose that has a stamp."""
    stamped = poses.stamp_ns != 0
    latency: Array = (poses.arrival_ns[stamped] - poses.stamp_ns[stamped]) / 1e9
    return latency


def _bodies(poses: PoseTrack) -> list[str]:
    apart = bodies_apart(poses.position)
    if apart <= 0.0:
        return []
    return [
        f"poses of two bodies or more take turns in one topic, {apart:.2f} m apart: is it "
        "published twice? The nodes take them for one body that leaps"
    ]


def _frames(poses: PoseTrack) -> list[str]:
    names, counts = np.unique(poses.frame, return_counts=True)
    return [
        f"frame_id is '{name}' in {_of(count, len(poses.frame))} poses, not 'map': the nodes "
        f"refuse them (--frame-ok '{name}' takes it for map)"
        for name, count in zip(names.tolist(), counts.tolist(), strict=True)
        if name != FRAME_MAP
    ]


def _numbers(poses: PoseTrack, sound: NDArray[np.bool_], norms: Array) -> list[str]:
    found: list[str] = []
    total = len(sound)
    if not sound.all():
        found.append(f"{_of(int((~sound).sum()), total)} poses are not finite")
    zero = sound & (norms < 1e-9)
    if zero.any():
        found.append(f"{_of(int(zero.sum()), total)} quaternions are zero")
    off = sound & ~zero & (np.abs(norms - 1.0) > _UNIT)
    if off.any():
        low, high = norms[off].min(), norms[off].max()
        found.append(
            f"{_of(int(off.sum()), total)} quaternions are not unit (norm {low:.3f} to {high:.3f})"
        )
    if sound.any():
        farthest = float(np.abs(poses.position[sound]).max())
        if farthest > _FAR_M:
            found.append(f"positions reach {farthest:.0f} m from the origin: millimetres?")
    return found


def _stamps(poses: PoseTrack) -> list[str]:
    found: list[str] = []
    zero = poses.stamp_ns == 0
    total = len(zero)
    if zero.any():
        found.append(
            f"{_of(int(zero.sum()), total)} stamps are zero (--stamp-on-arrival stamps all poses "
            "when they arrived)"
        )
    steps = np.diff(poses.stamp_ns[~zero])
    back, same = int((steps < 0).sum()), int((steps == 0).sum())
    if back:
        worst = -steps.min() / 1e9
        found.append(f"stamps go backwards {_times(back)}, by {worst:.3f} s at most")
    if same:
        found.append(f"{_of(same, total)} stamps are those of the pose before")
    return found


def _clock(poses: PoseTrack) -> list[str]:
    """Look at arrival minus stamp: its middle, its ends (drift), and its jumps."""
    late = latency_s(poses)
    if len(late) < 10:
        return []
    middle = float(np.median(late))
    begin, end = (float(np.median(part)) for part in (late[: len(late) // 8 + 1],
                                                      late[-(len(late) // 8 + 1) :]))  # fmt: skip
    span = float(poses.arrival_ns[-1] - poses.arrival_ns[0]) / 1e9
    steps = np.abs(np.diff(late))
    jumps = int((steps > _JUMP_S).sum())
    found: list[str] = []
    if middle < -_AHEAD_S:
        found.append(
            f"stamps run {_seconds(-middle)} ahead of arrival: two clocks "
            f"(--shift-stamps {middle - 0.01:.3f} makes up for it)"
        )
    elif middle > _BEHIND_S:
        found.append(
            f"stamps run {_seconds(middle)} behind arrival: two clocks, or a slow way "
            f"(--shift-stamps {middle - 0.01:.3f} makes up for it)"
        )
    drift = end - begin
    if abs(drift) > _DRIFT_S and not jumps and span > 0.0:
        how = "fall behind" if drift > 0.0 else "run away from"
        found.append(
            f"stamps {how} arrival by {_seconds(abs(drift))} over {span:.0f} s "
            f"({abs(drift) / span * 1e6:.0f} ppm): the clocks drift"
        )
    if jumps:
        found.append(
            f"arrival minus stamp jumps {_times(jumps)}, by {_seconds(float(steps.max()))} at "
            "most: a clock was set, or delivery stalled"
        )
    return found


def _gaps(poses: PoseTrack, gap_max_s: float) -> list[str]:
    steps = np.diff(poses.stamp_ns) / 1e9
    gaps = np.flatnonzero(steps > gap_max_s)
    if not len(gaps):
        return []
    longest = int(gaps[np.argmax(steps[gaps])])
    when = (poses.arrival_ns[longest] - poses.arrival_ns[0]) / 1e9
    return [
        f"{_number(len(gaps), 'gap')} of more than {gap_max_s:g} s between stamps, the longest "
        f"{steps[longest]:.2f} s after {when:.1f} s"
    ]


def _of(count: int, total: int) -> str:
    return f"{count} of {total}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _number(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if value >= 1.0 else f"{1e3 * value:.0f} ms"

"""The poses of a recording, and their checks before a replay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_bag.formats.bag_files import TopicSummary
from tombo_bag.message_codec import fields_of
from tombo_bag.recording import Recording
from tombo_bag.topics import MOCAP_POSE, POSE_TYPES, TOPICS
from tombo_dynamics.arrays import Array, Times
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_dynamics.rotation import body_to_map
from tombo_dynamics.vehicle import GRAVITY

_STEP_S = 0.2
"""Poses are averaged over this time, and accelerations taken from three such means."""
_LEAST_SAMPLES = 40
_CLIMB_M = 0.3
_USUAL = 0.85
"""Share of the accelerations that is looked at; the rest are strikes."""
_CLEARER = 1.7
_FLIES = 0.3
"""Correlation of horizontal acceleration with g tan(tilt), above which the tilt makes it."""
_MOVING = 0.15
"""m/s^2: below, the vehicle has hardly moved and tilt shows no axis."""
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class PoseTrack:
    """Poses of base_link as they arrived, N of them."""

    arrival_ns: Times
    """Log times, never falling."""
    stamp_ns: Times
    """Capture times of the headers."""
    frame: NDArray[np.str_]
    position: Array
    """(N, 3) [m]."""
    attitude: Array
    """(N, 4) quaternions xyzw, as recorded."""

    @staticmethod
    def none() -> PoseTrack:
        """Return a track without poses."""
        times = np.zeros(0, np.int64)
        return PoseTrack(times, times, np.zeros(0, "U1"), np.zeros((0, 3)), np.zeros((0, 4)))

    def renamed(self, accepted: str) -> PoseTrack:
        """Return the track with frame `accepted` taken for map."""
        return replace(self, frame=np.where(self.frame == accepted, FRAME_MAP, self.frame))

    def shifted(self, shift_ns: int) -> PoseTrack:
        """Return the track with all stamps moved."""
        return replace(self, stamp_ns=self.stamp_ns + shift_ns)

    def with_arrival_stamps(self) -> PoseTrack:
        """Return the track with the arrival as stamp."""
        return replace(self, stamp_ns=self.arrival_ns)


def find_pose_topic(topics: Mapping[str, TopicSummary]) -> str | None:
    """Return the topic with the vehicle's poses; None without a candidate.

    Raises:
        InputError: several candidates, or `/mocap/pose` has a type that holds no pose.
    """
    known = topics.get(MOCAP_POSE.name)
    if known is not None:
        if known.typename not in POSE_TYPES:
            raise InputError(
                f"{MOCAP_POSE.name} has type {known.typename}; accepted: {', '.join(POSE_TYPES)}"
            )
        return MOCAP_POSE.name
    found = [
        name
        for name, stream in topics.items()
        if stream.typename in POSE_TYPES and stream.count and name not in TOPICS
    ]
    if len(found) > 1:
        listed = ", ".join(f"{name} ({topics[name].count} messages)" for name in found)
        raise InputError(
            f"several topics could be the vehicle's poses: {listed}; accepted: "
            f"--map TOPIC:={MOCAP_POSE.name} with one of them"
        )
    return found[0] if found else None


def read_poses(recording: Recording, topic: str) -> PoseTrack:
    """Read a topic of one of `POSE_TYPES`."""
    fields = fields_of(recording.topics[topic].typename, recording.columns(topic))
    return PoseTrack(
        fields["log_time_ns"],
        fields["stamp_ns"],
        fields.get("frame_id", np.zeros(0, "U1")),
        fields.get("position", np.zeros((0, 3))),
        fields.get("attitude", np.zeros((0, 4))),
    )


def find_up_axis(time_s: Array, position: Array, attitude: Array) -> list[str]:
    """Return a finding if another axis than z points up, or base_link hangs upside down.

    Args:
        time_s: (N,) capture times.
        position: (N, 3) [m].
        attitude: (N, 4) unit quaternions xyzw.
    """
    upright = body_to_map(attitude, np.array(_AXES["z"]))[:, 2]
    if np.median(upright) < 0.0:
        return ["base_link z points down: attitudes of a z-down body (NED, FRD)?"]
    climbs = [axis for i, axis in enumerate("xyz") if _climbs(position[:, i])]
    means = _slot_means(time_s, position, attitude)
    if "z" in climbs or means is None:
        return []
    misfit = {axis: _misfit(*means, axis) for axis in _AXES}
    if not climbs:
        return _from_tilt_alone(*means, misfit)
    axis = min(climbs, key=lambda name: misfit[name])
    where = f"axis {axis} looks like up: the flight begins and ends lowest on {axis}, not on z"
    if misfit[axis] > misfit["z"] / _CLEARER:
        if not _flies(*means, axis, "z"):
            return []
        return [
            f"{where}; but tilt does not agree: position and attitude seem to have different axes"
        ]
    return [f"{where}, and tilt agrees (OptiTrack Motive: set the streamed up axis to Z)"]


def _from_tilt_alone(acceleration: Array, attitude: Array, misfit: dict[str, float]) -> list[str]:
    """Return a finding for a flight that neither begins nor ends on the ground."""
    axis = min(misfit, key=lambda name: misfit[name])
    if axis == "z" or misfit["z"] < max(_CLEARER * misfit[axis], _MOVING):
        return []
    if not _flies(acceleration, attitude, axis, axis):
        return []
    return [f"axis {axis} looks like up: only so does tilt agree with the accelerations"]


def _climbs(height: Array) -> bool:
    """Tell whether a flight begins and ends where it is lowest, and is far above most of it."""
    low, high = float(height.min()), float(height.max())
    climb = high - low
    ends = max(float(height[0]), float(height[-1]))
    return (
        climb > _CLIMB_M
        and ends - low < 0.15 * climb
        and float(np.median(height)) > (low + 0.3 * climb)
    )


def _slot_means(time_s: Array, position: Array, attitude: Array) -> tuple[Array, Array] | None:
    """Return means over `_STEP_S`: (N, 3) accelerations [m/s^2], (N, 3, 3) body axes in map.

    None: the track is too short, or has too many gaps.
    """
    count = int((time_s[-1] - time_s[0]) / _STEP_S)
    if count < _LEAST_SAMPLES:
        return None
    slot = np.clip(((time_s - time_s[0]) / _STEP_S).astype(np.int64), 0, count - 1)
    filled = np.bincount(slot, minlength=count)
    if (filled == 0).mean() > 0.2:
        return None

    def means(values: Array) -> Array:
        sums = [np.bincount(slot, values[:, i], count) for i in range(values.shape[1])]
        with np.errstate(invalid="ignore"):
            return np.stack(sums, axis=1) / filled[:, None]

    where = means(position)
    acceleration = (where[2:] - 2.0 * where[1:-1] + where[:-2]) / _STEP_S**2
    axes = [means(body_to_map(attitude, np.array(axis)))[1:-1] for axis in _AXES.values()]
    known = np.isfinite(acceleration).all(axis=1)
    return (acceleration[known], np.stack(axes, axis=1)[known]) if known.any() else None


def _misfit(acceleration: Array, body_axes: Array, axis: str) -> float:
    """Return the usual specific force across the body's up axis, with this axis up [m/s^2]."""
    body_up = body_axes[:, "xyz".index(axis)]
    force = acceleration + GRAVITY * np.array(_AXES[axis])
    across = force - np.sum(force * body_up, axis=1)[:, None] * body_up
    return float(np.quantile(np.linalg.norm(across, axis=1), _USUAL))


def _flies(acceleration: Array, body_axes: Array, position_up: str, body_up: str) -> bool:
    """Tell whether the body accelerates by its tilt; a body that is carried about does not."""
    level = np.delete(acceleration, "xyz".index(position_up), axis=1)
    k = "xyz".index(body_up)
    tilt = np.arccos(np.clip(body_axes[:, k, k], -1.0, 1.0))
    size, by_tilt = np.linalg.norm(level, axis=1), GRAVITY * np.tan(tilt)
    return float(np.corrcoef(size, by_tilt)[0, 1]) > _FLIES if np.ptp(by_tilt) > 0.0 else False


_UNIT = 1e-3
_AHEAD_S, _BEHIND_S = 0.002, 0.25
_DRIFT_S = 0.02
_JUMP_S = 0.25
_FAR_M = 100.0
_FROZEN = 5
_MOVED_M = 0.3


def check_poses(poses: PoseTrack, gap_max_s: float) -> list[str]:
    """Return the findings on a track of poses; `gap_max_s` as in the detector's parameters."""
    if not len(poses.stamp_ns):
        return []
    values = np.concatenate([poses.position, poses.attitude], axis=1)
    sound: NDArray[np.bool_] = np.isfinite(values).all(axis=1)
    norms = np.linalg.norm(poses.attitude, axis=1)
    findings = [
        *_bodies(poses),
        *_frames(poses),
        *_numbers(poses, sound, norms),
        *_stamps(poses),
        *_clock(poses),
        *_gaps(poses, gap_max_s),
    ]
    good = sound & (np.abs(norms - 1.0) < 0.1)
    if good.sum() >= 3:
        findings += _frozen(poses, good) + find_up_axis(
            (poses.stamp_ns[good] - poses.stamp_ns[good][0]) / 1e9,
            poses.position[good],
            poses.attitude[good] / norms[good][:, None],
        )
    return findings


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


def _frozen(poses: PoseTrack, good: NDArray[np.bool_]) -> list[str]:
    """Find poses that repeat to the last bit in flight: a motion capture sends them when lost."""
    values = np.concatenate([poses.position[good], poses.attitude[good]], axis=1)
    away = np.linalg.norm(values[:, :3] - values[0, :3], axis=1) > _MOVED_M
    same = (values[1:] == values[:-1]).all(axis=1) & away[1:]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    runs = edges[1::2] - edges[::2]
    long = runs >= _FROZEN
    if not long.any():
        return []
    return [
        f"the pose stands still to the last bit {_times(int(long.sum()))}, for up to "
        f"{int(runs.max())} poses: tracking was lost?"
    ]


def _of(count: int, total: int) -> str:
    return f"{count} of {total}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _number(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if value >= 1.0 else f"{1e3 * value:.0f} ms"

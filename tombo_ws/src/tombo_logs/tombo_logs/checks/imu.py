"""Checks of gyro and accelerometer: wrong units, axes, scales and offsets, late stamps.

An IMU with other units or axes is left out, and the flight diagnosed from the motion capture
alone.

Both sides of a comparison of scales are noisy. The slope of one on the other and the inverse of
the slope the other way round bracket the ratio of the two (Frisch, 1934): a ratio is only reported
where 1 is outside of that bracket.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import INDEPENDENT, EvenFlight
from tombo_logs.checks.pose_imu_consistency import (
    Alignment,
    alignment,
    drag_correlations,
    time_offset,
)
from tombo_logs.checks.spans import Mask, interpolated
from tombo_logs.readers.units import guess

_DRAG_SEEN = 0.9
"""Sum of both correlations that decides on the axes."""
_DRAG_CLEAR = 0.5
"""By how much the correlations of other axes of the accelerometer must be higher than ours."""
MAX_TURN_RAD = np.radians(20.0)
"""Turn between motion capture and IMU that is a fault; the diagnosis fits smaller ones."""
_YAWED = np.radians(5.0)
"""Turn from which on a warning says so: few define a rigid body so badly."""
_LATE_S = 0.005
"""Smaller differences of stamps are not reported [s]."""
_SIGMAS = 3.0
_TOGETHER = 0.6
"""Correlation from which on two signals are the same quantity."""
_TURNS, _ACCELERATES = 0.04, 0.3
"""rad/s and m/s^2: standard deviation of an axis that is compared."""
_GYRO_SCALE, _TRACK_SCALE = 1.15, 1.2
"""Ratio, or its inverse, that is reported. Smoothing of poses, drag of the vehicle and the time
between both streams change it by less."""
_GYRO_OFFSET = 0.06
"""rad/s that is reported."""
_ACROSS_OFFSET, _ALONG_OFFSET = 0.6, 0.5
"""m/s^2 across and along the thrust: markers may define a body that is turned by 3.5 deg."""
_UNITS = {"gyro": "rad/s", "accel": "m/s^2"}
_MAYBE = {"gyro": "", "accel": ": an offset, a scale, or a rigid body that was defined turned"}
"""Channel → causes that its offset may have."""


def check_accel(flight: str, accel: Series, flying: Mask) -> list[Finding]:
    """Report what contradicts specific force in m/s^2 along base_link (FLU); a fault drops it."""
    values = accel.values[flying] if np.count_nonzero(flying) > 20 else accel.values
    if len(values) < 5:
        return []
    size = float(np.median(np.linalg.norm(values, axis=1)))
    ratio = size / GRAVITY
    if not 0.6 < ratio < 1.6:
        why = guess(ratio, "force")
        if ratio < 0.3 and not why:
            why = ": gravity taken out, or nothing measured?"
        text = (
            f"accel: |accel| is {size:.3g} m/s^2 in flight; expected: about {GRAVITY:.2f}"
            f"{why}; gyro and accel are left out"
        )
        return [Finding("unit", "fault", flight, text, channel="accel")]
    mean = np.median(values, axis=0)
    mean /= max(float(np.linalg.norm(mean)), 1e-9)
    if mean[2] > 0.5:
        return []
    axis = int(np.argmax(np.abs(mean)))
    name = ("-" if mean[axis] < 0.0 else "") + "xyz"[axis]
    text = (
        f"accel: points along ({mean[0]:.2f}, {mean[1]:.2f}, {mean[2]:.2f}) in flight, its "
        f"{name} is up; expected: (0, 0, 1), base_link (FLU); is it FRD? In a mapping: axes "
        "of gyro and accel; they are left out"
    )
    return [Finding("frame", "fault", flight, text, channel="accel")]


def check_accel_axes(flight: str, motion: EvenFlight) -> list[Finding]:
    """Report an accelerometer whose x and y are swapped or reversed; a fault drops it."""
    seen = drag_correlations(motion)
    if seen is None:
        return []
    ways = {
        (order, signs): sum(signs[i] * float(seen[i, order[i]]) for i in range(2))
        for order in ((0, 1), (1, 0))
        for signs in product((1.0, -1.0), repeat=2)
    }
    best = max(ways, key=lambda way: ways[way])
    if ways[best] < max(ways[(0, 1), (1.0, 1.0)] + _DRAG_CLEAR, _DRAG_SEEN):
        return []
    axes = [("-" if sign < 0.0 else "") + "xy"[axis] for axis, sign in zip(*best, strict=True)]
    text = (
        f"accel: its x and y read the drag that by the poses is along {axes[0]} and {axes[1]}; "
        "expected: x and y of base_link (FLU); gyro and accel are left out"
    )
    return [Finding("frame", "fault", flight, text, channel="accel")]


def check_gyro(flight: str, motion: EvenFlight) -> tuple[list[Finding], float | None]:
    """Report what contradicts rates in rad/s about base_link (FLU), and when stamps are late.

    Returns the findings and the size of the gyro's rates against those of the attitude.
    """
    late = time_offset(motion)
    together = alignment(motion, late.lag if late else 0.0)
    if together is None or together.explained < 0.3:
        return [], None
    if not 0.33 < together.scale < 3.0:
        text = (
            f"gyro: rates are {together.scale:.3g} times those of the attitude; expected: the same"
            f"{guess(together.scale, 'angle', 'turning')}; gyro and accel are left out"
        )
        return [Finding("unit", "fault", flight, text, channel="gyro")], together.scale
    findings = _turn_findings(flight, together)
    if not any(f.severity == "fault" for f in findings):
        findings += gyro_scales(flight, motion, late.lag if late else 0.0)
    if late is not None and abs(late.lag) >= max(_LATE_S, 3.0 * late.sigma):
        text = (
            f"position: stamps are {1e3 * abs(late.lag):.0f} ± {1e3 * late.sigma:.0f} ms "
            f"{'later' if late.lag > 0.0 else 'earlier'} than the gyro's"
        )
        severity = "warning" if abs(late.lag) > 0.02 else "info"
        findings.append(Finding("stamps", severity, flight, text, channel="position"))
    return findings, together.scale


def _turn_findings(flight: str, together: Alignment) -> list[Finding]:
    matrix = together.turn.as_matrix() * (-1.0 if together.mirrored else 1.0)
    axes = _axes_of(matrix.T)
    channel = "gyro"
    remedy = f"axes: [{', '.join(axes)}] for gyro and accel" if axes else ""
    if together.mirrored:
        text = "gyro: turns mirrored to the attitude; expected: both right-handed"
        if np.allclose(matrix, -np.eye(3), atol=0.4):
            text += "; is the attitude base_link from map?"
    elif together.angle > max(MAX_TURN_RAD, 3.0 * together.sigma):
        roll, pitch, yaw = together.turn.inv().as_euler("xyz", degrees=True)
        turn = f"turn_deg: [{roll:.1f}, {pitch:.1f}, {yaw:.1f}] if the attitude is"
        angles = (
            f"turned by {np.degrees(together.angle):.0f} ± {np.degrees(together.sigma):.0f} deg "
            "against the"
        )
        if axes:
            text, remedy = f"gyro: {angles} attitude", f"{remedy}, or {turn}"
        else:  # an IMU is mounted square; a rigid body is defined as the vehicle stood
            channel, remedy = "attitude", turn
            text = f"attitude: its body is {angles} gyro's axes, or they are"
        text += "; expected: both in base_link (FLU)"
    else:
        if together.angle < max(np.radians(1.0), 3.0 * together.sigma):
            return []
        roll, pitch, yaw = together.turn.as_euler("xyz", degrees=True)
        text = (
            f"attitude: its body is turned by roll {roll:.1f}, pitch {pitch:.1f}, yaw {yaw:.1f} "
            f"deg (± {np.degrees(together.sigma):.1f}) against the gyro's; the diagnosis fits that"
        )
        severity = "warning" if together.angle > max(_YAWED, 3.0 * together.sigma) else "info"
        return [Finding("frame", severity, flight, text, channel="attitude")]
    text += f"; in a mapping: {remedy}" if remedy else ""
    text += "; gyro and accel are left out"
    return [Finding("frame", "fault", flight, text, channel=channel)]


def _axes_of(matrix: Array) -> list[str]:
    """Return axes as in a mapping if the matrix is nearly a change of axes, else nothing."""
    near = np.round(matrix)
    if np.abs(matrix - near).max() > 0.35 or (np.abs(near).sum(axis=1) != 1.0).any():
        return []
    if np.array_equal(near, np.eye(3)):
        return []
    return [("-" if row.sum() < 0.0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in near]


def gyro_scales(flight: str, motion: EvenFlight, late_s: float) -> list[Finding]:
    """Report axes of the gyro that read another rate than the attitude has.

    Args:
        flight: name.
        motion: of poses and IMU.
        late_s: delay of the poses' stamps against the gyro's.
    """
    if not motion.is_compared(motion.gyro):
        return []
    rates = interpolated(motion.t + late_s, motion.t, motion.rates)[motion.valid]
    gyro = motion.gyro[motion.valid]
    scales = _scales(flight, "gyro", rates, gyro, (_TURNS, _GYRO_SCALE), "the attitude's rate")
    return [*scales, *_offsets(flight, "gyro", rates, gyro, [_GYRO_OFFSET] * 3)]


def accel_offsets(flight: str, motion: EvenFlight) -> list[Finding]:
    """Report axes of the accelerometer that on average read another force than the poses give."""
    if not motion.is_compared(motion.accel):
        return []
    good, limits = motion.valid, [_ACROSS_OFFSET, _ACROSS_OFFSET, _ALONG_OFFSET]
    return _offsets(flight, "accel", motion.force_of_poses[good], motion.accel[good], limits)


def track_scales(flight: str, motion: EvenFlight) -> list[Finding]:
    """Report axes of the map along which the track accelerates otherwise than the IMU says."""
    if not motion.is_compared(motion.accel):
        return []
    good = motion.valid
    what = "the accelerometer's, turned by the attitude"
    limits = _ACCELERATES, _TRACK_SCALE
    track = motion.acceleration[good]
    return _scales(flight, "position", motion.accel_in_map[good], track, limits, what)


def _ratio(expected: Array, found: Array, least: float) -> tuple[float, float] | None:
    """Return the lowest and the highest ratio of `found` to `expected`, both (N,).

    None: they are not the same quantity, or change by less than `least`.
    """
    x, y = expected - expected.mean(), found - found.mean()
    sizes = float(x.std()), float(y.std())
    if sizes[0] < least or sizes[1] < 1e-9:
        return None
    together = float(np.mean(x * y)) / (sizes[0] * sizes[1])
    if together < _TOGETHER:
        return None
    ratio = sizes[1] / sizes[0]
    noise = np.sqrt((1.0 - together**2) * INDEPENDENT / x.size) / together
    return ratio * together * (1.0 - _SIGMAS * noise), ratio / together * (1.0 + _SIGMAS * noise)


def _is_beyond(bracket: tuple[float, float], limit: float) -> bool:
    return bracket[0] > limit or bracket[1] < 1.0 / limit


def _scales(
    flight: str, channel: str, expected: Array, measured: Array, limits: tuple[float, float],
    against: str,
) -> list[Finding]:  # fmt: skip
    """Report axes of (N, 3) whose scale differs; limits: least change, and ratio."""
    findings = []
    for k, axis in enumerate("xyz"):
        bracket = _ratio(expected[:, k], measured[:, k], limits[0])
        if bracket is not None and _is_beyond(bracket, limits[1]):
            text = (
                f"{channel}: its {axis} moves {bracket[0]:.2f} to {bracket[1]:.2f} times as much "
                f"as {against}; expected: 1, one scale for all axes"
            )
            findings.append(Finding("scale", "warning", flight, text, channel=channel))
    return findings


def _offsets(
    flight: str, channel: str, expected: Array, measured: Array, limits: Sequence[float]
) -> list[Finding]:
    """Report axes of (N, 3) that read something else throughout; limits by axis."""
    left = measured - expected
    offsets, sigmas = left.mean(axis=0), left.std(axis=0) * np.sqrt(INDEPENDENT / len(left))
    findings = []
    for axis, offset, sigma, limit in zip("xyz", offsets, sigmas, limits, strict=True):
        if abs(offset) > max(limit, _SIGMAS * sigma):
            text = (
                f"{channel}: its {axis} reads {offset:+.3f} ± {sigma:.3f} {_UNITS[channel]} "
                f"beside what the poses give{_MAYBE[channel]}; expected: 0"
            )
            findings.append(Finding("offset", "warning", flight, text, channel=channel))
    return findings

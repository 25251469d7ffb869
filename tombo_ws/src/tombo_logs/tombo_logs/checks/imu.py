"""Checks of gyro and accelerometer: wrong units, wrong axes, late stamps.

Such an IMU is left out, and the flight diagnosed from the motion capture alone.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import EvenFlight
from tombo_logs.checks.pose_imu_consistency import (
    Alignment,
    alignment,
    drag_correlations,
    time_offset,
)
from tombo_logs.checks.scales import gyro_scales
from tombo_logs.checks.spans import Mask
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

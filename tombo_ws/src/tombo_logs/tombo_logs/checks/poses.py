"""Poses that contradict themselves, or the IMU: they can't be worked around, which is an error."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.motion import Motion
from tombo_logs.checks.pose_imu_consistency import force_response, lean_explains, tilt_response
from tombo_logs.checks.unit_mistakes import guess
from tombo_logs.flight_log import Series

_SIZES = (0.4, 2.5)
"""Acceleration of the track over what its lean gives: drag and wind change it by far less."""
_LEANS = 5.0
"""From this ratio on it is the lean that is too small, if the acceleration is a possible one."""
_EXPLAINED, _CONTRADICTED = 0.6, 0.35
"""Share of the track's acceleration that other axes explain, and share that they may leave of what
ours leave, to be the right ones."""


def check_attitude(flight: str, attitude: Series) -> None:
    """Refuse quaternions whose usual norm is not 1, or that never change."""
    if len(attitude.values) > 20 and not np.ptp(attitude.values, axis=0).any():
        raise InputError(f"flight '{flight}': attitude: one value throughout; expected: a flight")
    norm = np.linalg.norm(attitude.values, axis=1)
    usual = float(np.median(norm))
    if abs(usual - 1.0) > 0.02:
        text = f"quaternions have norm {usual:.3g}; expected: 1"
        raise InputError(f"flight '{flight}': attitude: {text}")


def check_tilt(flight: str, motion: Motion) -> None:
    """Refuse attitudes that lean far for long while the track is calm."""
    good = motion.good
    if np.count_nonzero(good) < 50:
        return
    up = motion.up[good]
    mean = up.mean(axis=0)
    if mean[2] < 0.5 and np.linalg.norm(mean) > 0.7:
        raise InputError(
            f"flight '{flight}': attitude: body z points along ({_shown(mean[None])}) of map in "
            "flight; expected: up, (0 0 1); is it wxyz read as xyzw, y up, NED or FRD?"
        )
    share = float(np.mean(up[:, 2] < 0.5))
    push = float(np.median(np.linalg.norm(motion.acceleration[good], axis=1)))
    if share > 0.15 and push < 0.5 * GRAVITY:
        raise InputError(
            f"flight '{flight}': attitude: leans by more than 60 deg for {100 * share:.0f} % of "
            f"the flight while the track accelerates by {push:.1f} m/s^2; expected: lean and "
            "acceleration go together; degrees declared as radians, or another order?"
        )


def check_lean(flight: str, motion: Motion) -> None:
    """Refuse poses whose track goes with its lean only once one of them is turned over.

    Thrust along body z gives the track's horizontal acceleration. Tried are the inverse attitude,
    and the track with axes swapped or reversed.
    """
    good = motion.good
    if np.count_nonzero(good) < 100:
        return
    turn = Rotation.from_quat(motion.attitude[good])
    own = lean_explains(motion, turn)
    others = {
        "attitude: its inverse does; is it base_link from map? Expected: map from base_link": (
            lean_explains(motion, turn.inv())
        )
    }
    for order in ((0, 1), (1, 0)):
        for signs in product((1.0, -1.0), repeat=2):
            axes = [("-" if g < 0.0 else "") + "xy"[k] for k, g in zip(order, signs, strict=True)]
            text = (
                f"position: with its {', '.join(axes)} as x, y it does; expected: ENU, as attitude"
            )
            matrix = np.eye(2)[list(order)] * np.array(signs)[:, None]
            others[text] = lean_explains(motion, turn, matrix)
    best = max(others, key=lambda text: others[text])
    if others[best] > _EXPLAINED and 1.0 - others[best] < _CONTRADICTED * (1.0 - own):
        raise InputError(
            f"flight '{flight}': the lean of the attitude does not give the acceleration of the "
            f"position ({100 * max(own, 0.0):.0f} % explained, else {100 * others[best]:.0f} %); "
            f"{best}"
        )


def check_poses(flight: str, motion: Motion, scale: float | None, imu: bool) -> None:
    """Refuse poses whose position and attitude contradict each other.

    `scale` is the size of the gyro's rates against those of the attitude, None: not known; `imu`
    says whether the accelerometer can be relied upon.

    Raises:
        InputError: says what is seen and what is expected.
    """
    lean = tilt_response(motion)
    size = _size(motion)
    if scale is not None and not 0.33 < scale < 3.0 and not _SIZES[0] < size < _SIZES[1]:
        raise InputError(
            f"flight '{flight}': attitude: leans and turns {1.0 / size:.3g} times as much as "
            f"position and gyro show{guess(1.0 / size, ('degrees', 'radians'))}"
        )
    _check_size(flight, motion, size)
    if imu and motion.accel.size:
        _check_axes(flight, force_response(motion), 45.0, "turned by the attitude, accel says")
    elif lean is not None:
        u, s, vt = np.linalg.svd(lean[0])
        if s[1] > 0.25 * s[0]:  # else it moved along one line only
            _check_axes(flight, (u @ vt, lean[1]), 120.0, "the attitude leans")


def _size(motion: Motion) -> float:
    """Return how much the track accelerates against what its lean gives; 1: not known."""
    response = tilt_response(motion)
    if response is None or response[1] < 0.3:
        return 1.0
    return float(np.linalg.norm(response[0]) / np.sqrt(2.0))


def _check_size(flight: str, motion: Motion, size: float) -> None:
    good = motion.good
    if np.count_nonzero(good) < 50 or _SIZES[0] < size < _SIZES[1]:
        return
    usual = float(np.median(np.linalg.norm(motion.acceleration[good], axis=1)))
    among: tuple[str, ...] = ("m declared", "ft declared")
    seen, times, given = f"position: accelerates by {usual:.3g} m/s^2,", size, "lean"
    if size > _LEANS and usual < 2.0 * GRAVITY:
        seen, times, given = "attitude: leans", 1.0 / size, "acceleration"
        among = ("radians declared",)
    raise InputError(
        f"flight '{flight}': {seen} {times:.3g} times what its {given} gives"
        f"{guess(times, among)}; expected: about 1, both in the axes of map, z up"
    )


def _check_axes(
    flight: str, response: tuple[Array, float] | None, limit_deg: float, where: str
) -> None:
    """Refuse a track that moves elsewhere than expected, by a turn or mirror in 2 or 3 axes."""
    if response is None or response[1] < 0.5:
        return
    turn = response[0]
    size = len(turn)
    if np.linalg.det(turn) < 0.0:
        raise InputError(
            f"flight '{flight}': position: it moves mirrored to where {where} ({_shown(turn)}); "
            "expected: the same way; are two axes swapped, or is one reversed?"
        )
    cosine = (np.trace(turn) - (size - 2)) / 2.0
    angle = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    if angle > limit_deg:
        raise InputError(
            f"flight '{flight}': position: it moves {angle:.0f} deg off where {where} "
            f"({_shown(turn)}); expected: the same way; are position and attitude in one world "
            "frame, ENU, z up, and is the attitude map from base_link?"
        )


def check_height(flight: str, position: Series) -> None:
    """Refuse a track that goes down from where the vehicle stands: z is not up."""
    z, t = position.values[:, 2], position.t
    if z.size > 20 and not np.ptp(position.values, axis=0).any():
        raise InputError(f"flight '{flight}': position: one value throughout; expected: a flight")
    begin = t < t[0] + 0.6
    if np.count_nonzero(begin) < 6:
        return
    noise = 1.4826 * np.median(np.abs(np.diff(z[begin], 2))) / np.sqrt(6.0)
    level = float(np.median(z[begin]))
    still = np.ptp(z[begin]) < max(8.0 * noise, 0.004)
    if still and np.median(z) < level - 0.3 and np.percentile(z, 98.0) < level + 0.05:
        raise InputError(
            f"flight '{flight}': position: z goes from {level:.2f} m, where it stands, to "
            f"{np.median(z):.2f} m; expected: up, as in ENU; is it NED, or y up?"
        )


def _shown(matrix: Array) -> str:
    return "; ".join(" ".join(f"{x:.2f}" for x in row) for row in matrix)

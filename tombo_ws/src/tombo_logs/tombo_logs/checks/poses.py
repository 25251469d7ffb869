"""Poses that contradict themselves, or the IMU: nothing can be diagnosed from such a flight."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_bag.flight import RefusedLog, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import EvenFlight
from tombo_logs.checks.pose_imu_consistency import force_response, tilt_response
from tombo_logs.checks.spans import white_noise
from tombo_logs.readers.units import guess

_SIZES = (0.4, 2.5)
"""Acceleration of the track over what its lean gives: drag and wind change it by far less."""
_LEANS = 5.0
"""From this ratio on it is the lean that is too small, if the acceleration is a possible one."""
_STANDS = 0.5
"""Speed or command of the motors over that in flight below which they can't carry the vehicle."""


def check_values(flight: str, series: Mapping[str, Series]) -> None:
    """Refuse poses that never change, and quaternions whose usual norm is not 1."""
    for name in sorted({"attitude", "position"} & series.keys()):
        values = series[name].values
        if len(values) > 20 and not np.ptp(values, axis=0).any():
            raise RefusedLog(flight, name, f"{name}: one value throughout; expected: a flight")
    if "attitude" in series:
        usual = float(np.median(np.linalg.norm(series["attitude"].values, axis=1)))
        if abs(usual - 1.0) > 0.02:
            text = f"attitude: quaternions have norm {usual:.3g}; expected: 1"
            raise RefusedLog(flight, "attitude", text)


def check_tilt(flight: str, motion: EvenFlight) -> None:
    """Refuse attitudes that lean far for long while the track is calm."""
    usable = motion.valid
    if np.count_nonzero(usable) < 50:
        return
    up = motion.up[usable]
    mean = up.mean(axis=0)
    if mean[2] < 0.5 and np.linalg.norm(mean) > 0.7:
        raise RefusedLog(
            flight,
            "attitude",
            f"attitude: body z points along ({_shown(mean[None])}) of map in "
            "flight; expected: up, (0 0 1); is it wxyz read as xyzw, y up, NED or FRD?",
        )
    share = float(np.mean(up[:, 2] < 0.5))
    push = float(np.median(np.linalg.norm(motion.acceleration[usable], axis=1)))
    if share > 0.15 and push < 0.5 * GRAVITY:
        raise RefusedLog(
            flight,
            "attitude",
            f"attitude: leans by more than 60 deg for {100 * share:.0f} % of "
            f"the flight while the track accelerates by {push:.1f} m/s^2; expected: lean and "
            "acceleration go together; degrees declared as radians, or another order?",
        )


def check_poses(flight: str, motion: EvenFlight, scale: float | None, imu: bool) -> None:
    """Refuse poses whose position and attitude contradict each other.

    `scale` is the size of the gyro's rates against those of the attitude, None: not known; `imu`
    says whether the accelerometer can be relied upon.

    Raises:
        RefusedLog: names observation and expectation.
    """
    lean = tilt_response(motion)
    size = _size(motion)
    if scale is not None and not 0.33 < scale < 3.0 and not _SIZES[0] < size < _SIZES[1]:
        raise RefusedLog(
            flight,
            "attitude",
            f"attitude: leans and turns {1.0 / size:.3g} times as much as "
            f"position and gyro show{guess(1.0 / size, 'angle')}",
        )
    _check_size(flight, motion, size)
    if imu and motion.accel.size:
        _check_axes(flight, force_response(motion), 45.0, "turned by the attitude, accel says")
    elif lean is not None:
        u, s, vt = np.linalg.svd(lean[0])
        if s[1] > 0.25 * s[0]:  # else it moved along one line only
            _check_axes(flight, (u @ vt, lean[1]), 120.0, "the attitude leans")


def _size(motion: EvenFlight) -> float:
    """Return how much the track accelerates against what its lean gives; 1: not known."""
    response = tilt_response(motion)
    if response is None or response[1] < 0.3:
        return 1.0
    return float(np.linalg.norm(response[0]) / np.sqrt(2.0))


def _check_size(flight: str, motion: EvenFlight, size: float) -> None:
    usable = motion.valid
    if np.count_nonzero(usable) < 50 or _SIZES[0] < size < _SIZES[1]:
        return
    usual = float(np.median(np.linalg.norm(motion.acceleration[usable], axis=1)))
    channel, seen, times = "position", f"accelerates by {usual:.3g} m/s^2,", size
    given, quantity = "lean", "length"
    if size > _LEANS and usual < 2.0 * GRAVITY:
        channel, seen, times = "attitude", "leans", 1.0 / size
        given, quantity = "acceleration", "angle"
    raise RefusedLog(
        flight,
        channel,
        f"{channel}: {seen} {times:.3g} times what its {given} gives"
        f"{guess(times, quantity)}; expected: about 1, both in the axes of map, z up",
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
        raise RefusedLog(
            flight,
            "position",
            f"position: it moves mirrored to where {where} ({_shown(turn)}); "
            "expected: the same way; are two axes swapped, or is one reversed?",
        )
    cosine = (np.trace(turn) - (size - 2)) / 2.0
    angle = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    if angle > limit_deg:
        raise RefusedLog(
            flight,
            "position",
            f"position: it moves {angle:.0f} deg off where {where} "
            f"({_shown(turn)}); expected: the same way; are position and attitude in one world "
            "frame, as in ENU and not NED, and is the attitude map from base_link?",
        )


def check_height(flight: str, position: Series, drive: Array) -> None:
    """Refuse a track that goes down from where the vehicle stands with slow motors: z is not up.

    `drive` (N,): the motors' mean speed or command over that in flight; NaN: not known. A steady
    hover is as quiet as the ground, so quiet poses alone don't tell a floor.
    """
    z, t = position.values[:, 2], position.t
    begin = t < t[0] + 0.6
    if np.count_nonzero(begin) < 6 or not np.median(drive[begin]) < _STANDS:
        return
    noise = white_noise(z[begin])
    level = float(np.median(z[begin]))
    still = np.ptp(z[begin]) < max(8.0 * noise, 0.004)
    if still and np.median(z) < level - 0.3 and np.percentile(z, 98.0) < level + 0.05:
        raise RefusedLog(
            flight,
            "position",
            f"position: z goes from {level:.2f} m, where it stands, to "
            f"{np.median(z):.2f} m; expected: up, as in ENU; is it NED, or y up?",
        )


def _shown(matrix: Array) -> str:
    return "; ".join(" ".join(f"{x:.2f}" for x in row) for row in matrix)

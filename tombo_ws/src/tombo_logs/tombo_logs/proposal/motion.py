"""Two tests of motion, of a track's axes and of an attitude's form.

A multirotor is pushed along its body z axis. So the tilt that the attitude gives must agree with
the acceleration of the track, and the rates of the attitude with the gyro. Both are computed for
each reading of the columns; the best reading is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import RATE, poses_and_imu
from tombo_logs.checks.spans import Mask
from tombo_logs.readers.frames import BODIES, WORLDS, axes_matrix, is_usable

_WIDTH: Final = 0.1 * RATE
"""Samples: standard deviation of the Gaussian that all signals pass through besides."""
_LEAST_SAMPLES: Final = 100
_MOVES: Final = 0.1
"""m/s^2 and rad/s, standard deviation: horizontal acceleration and rates that show anything."""
AGREES: Final = 0.5
"""Correlation from which on a test says something."""
CLOSE: Final = 0.1
"""Difference of two scores that says nothing."""
_NOT_TOLD: Final = (float("nan"),) * 3
_USUAL: Final = [("ENU", "FLU"), ("NED", "FRD")]
"""Axes, unless the motion speaks for others."""
WORLD_AXES: Final = {"ENU": WORLDS["ENU"], "NED": WORLDS["NED"], "y up": ("x", "-z", "y")}
BODY_AXES: Final = {
    "FLU": BODIES["FLU"],
    "FRD": BODIES["FRD"],
    "y up": ("x", "-z", "y"),
    "x up": ("z", "-y", "x"),
    "x down": ("z", "y", "-x"),
}
"""Right-handed axes by what points up; where it is not z, forward is a guess."""


class Reading(NamedTuple):
    """One way to read the columns, and how well the motion agrees with it."""

    form: str
    """Key of the attitude's form."""
    world: str
    body: str
    tilt: float
    """Correlation of tilt and acceleration, mean of the axes that move; NaN: none does."""
    slope: float
    """Acceleration by the tilt over the track's: 1 where both are in SI."""
    rates: float
    """Correlation of the attitude's rates and the gyro; NaN: nothing turns, or no gyro."""
    gyro_scale: float
    """Size of the gyro's values over the attitude's rates [rad/s]; NaN as `rates`."""

    @property
    def score(self) -> float:
        """Sum of both correlations."""
        return float(np.nansum([self.tilt, self.rates]))


def readings(
    position: Series, attitudes: Mapping[str, Series], gyro: Series | None, accel: Series | None
) -> list[Reading]:
    """Return the readings that gravity allows, best first; usual axes unless others are clear.

    Args:
        position: (N, 3) in the file's axes [m].
        attitudes: form → (N, 4) xyzw, the file's world from its body.
        gyro: (N, 3) in the file's axes and unit.
        accel: (N, 3) in the file's axes, any unit.
    """
    allowed = []
    for form, attitude in attitudes.items():
        if np.count_nonzero(is_usable(attitude.values)) < 2:
            continue
        motion = poses_and_imu(position, attitude, gyro, None, [])
        if np.count_nonzero(motion.valid) < _LEAST_SAMPLES:
            continue
        rates = _NOT_TOLD
        if motion.gyro.size:
            rates = _agreement(motion.gyro, motion.rates, motion.valid)
        turn = Rotation.from_quat(motion.attitude)
        for world, axes in WORLD_AXES.items():
            in_world = axes_matrix(axes, world)
            for body, body_axes in BODY_AXES.items():
                up = axes_matrix(body_axes, body)[2]
                thrust = turn.apply(up) @ in_world.T
                if np.median(thrust[:, 2]) < 0.5 or not _points_up(accel, up):
                    continue
                lean = GRAVITY * thrust[:, :2] / np.maximum(thrust[:, 2:], 0.3)
                flat = (motion.acceleration @ in_world.T)[:, :2]
                tilt = _agreement(lean, flat, motion.valid)
                allowed.append(Reading(form, world, body, *tilt[:2], rates[0], rates[2]))
    ranked = sorted(allowed, key=lambda r: (-round(r.score, 2), _rank(r)))
    usual = next((r for r in ranked if _rank(r) < len(_USUAL)), None)
    if usual is None:
        return ranked
    first = ranked[0]
    clear = first.tilt > AGREES and first.slope > 0.0 and first.score > usual.score + CLOSE
    return ranked if clear else [usual, *(r for r in ranked if r is not usual)]


def _rank(reading: Reading) -> int:
    axes = (reading.world, reading.body)
    return _USUAL.index(axes) if axes in _USUAL else len(_USUAL)


def _agreement(given: Array, seen: Array, good: Mask) -> tuple[float, float, float]:
    """Return correlation of two signals (N, k), slope of `given` by `seen`, and ratio of sizes.

    The axes that move count alike: a quaternion in the wrong order agrees in one axis, with
    heading 0.
    """
    given, seen = (gaussian_filter1d(signal, _WIDTH, axis=0) for signal in (given, seen))
    strength = np.linalg.norm(seen, axis=1)
    calm = good & (strength < 8.0 * np.median(strength) + _MOVES)  # without jumps of the track
    given, seen = given[calm], seen[calm]
    moves = seen.std(axis=0) > _MOVES if len(seen) else np.zeros(0, np.bool_)
    if len(seen) < _LEAST_SAMPLES or not moves.any():
        return _NOT_TOLD
    g, s = (signal[:, moves] - signal[:, moves].mean(axis=0) for signal in (given, seen))
    norms = np.sqrt(np.sum(g**2, axis=0) * np.sum(s**2, axis=0))
    both = np.sum(g * s, axis=0) / np.maximum(norms, 1e-12)
    slope = np.sum(given * seen) / np.sum(seen**2)
    size = np.linalg.norm(given, axis=1) / np.maximum(np.linalg.norm(seen, axis=1), 1e-9)
    return float(np.mean(both)), float(slope), float(np.median(size))


def _points_up(accel: Series | None, up: Array) -> bool:
    """Return whether an accelerometer reads gravity along an axis of the body, or is absent."""
    if accel is None:
        return True
    norm = np.nanmedian(np.linalg.norm(accel.values, axis=1))
    return bool(np.nanmedian(accel.values @ up) > 0.7 * norm)

"""Wind: a horizontal force in map that stays.

Thrust acts along body z, so what else accelerates the vehicle sideways shows in the poses, and in
the accelerometer. A body that was defined leaning, and an offset of the accelerometer, look alike
in one of the two, and turn with the heading; a force on the vehicle shows in both. Drag goes with
the vehicle's own velocity: where flights show it, the force is a speed of the air.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import POSE_WIDTH, RATE, EvenFlight
from tombo_logs.checks.spans import block_means, interpolated

_BLOCK_S = 0.24
"""Means over such blocks are fitted."""
_CORRELATED_S = 1.5
"""Blocks of such a stretch count as one sample."""
_SHORTEST_S = 8.0
_LEANS = 0.35
"""Standard deviation of the force across the thrust from a tilted definition of the body, or an
offset of the accelerometer [m/s^2]: 2 deg."""
_FRAME_LEANS = 0.2
"""The same of a map whose z is not up: 1.2 deg. It stays when the heading turns."""
USUAL_DRAG, _FASTEST_AIR = 0.3, 5.0
"""Standard deviations before the data, of drag per mass [1/s] and of a steady push [m/s^2]."""
_SURE = 4.0
"""Standard deviations by which a push is called wind."""
LEAST = 0.4
"""m/s^2 of a push that is reported."""
DRAG_KNOWN = 0.2
"""Relative deviation of the drag up to which the air's speed is told."""


@dataclass(frozen=True)
class Push:
    """Horizontal force per mass that the vehicle's own motion does not make."""

    steady: Array
    """(2,) along map x, y [m/s^2]."""
    deviation: float
    """One standard deviation of its size [m/s^2]."""
    drag: float
    """Per mass [1/s]."""
    drag_deviation: float
    speed: float
    """Root of the mean square of the vehicle's own horizontal speed [m/s]."""

    @property
    def size(self) -> float:
        """Size of the steady part [m/s^2]."""
        return float(np.linalg.norm(self.steady))


def wind(flight: str, motion: EvenFlight, position: Series, mass: float | None) -> list[Finding]:
    """Report wind with its force, and its speed where drag is known.

    Args:
        flight: name.
        motion: of poses and IMU.
        position: its poses.
        mass: of the vehicle [kg]; None: not known.
    """
    push = push_of(motion, position)
    if push is None:
        return []
    if push.size <= max(LEAST, _SURE * push.deviation):
        return []
    unit, scale = ("N", mass) if mass is not None else ("m/s^2", 1.0)
    heading = round(math.degrees(math.atan2(push.steady[1], push.steady[0]))) % 360
    speed = "its speed is not known without the drag coefficient"
    if push.drag > 0.0 and push.drag_deviation < DRAG_KNOWN * push.drag:
        speed = f"by the drag that this flight shows, air of {push.size / push.drag:.1f} m/s"
    text = (
        "wind: a horizontal force beside the vehicle's own drag, "
        f"{scale * push.size:.2g} ± {2.0 * scale * push.deviation:.1g} {unit} "
        f"({push.size / GRAVITY:.2f} of the weight) towards {heading} deg from map x; {speed}"
    )
    return [Finding("wind", "warning", flight, text)]


def push_of(motion: EvenFlight, position: Series) -> Push | None:
    """Fit a steady push, drag and offsets; None: too short a flight."""
    block = round(_BLOCK_S * RATE)
    good = block_means(motion.valid.astype(np.float64), block) > 0.99
    if np.count_nonzero(good) * _BLOCK_S < _SHORTEST_S:
        return None
    track = interpolated(motion.t, position.t, position.values[:, :2])
    speed = gaussian_filter1d(track, POSE_WIDTH * RATE, axis=0, order=1) * RATE
    speed = block_means(speed, block)[good]
    turn = np.asarray(Rotation.from_quat(motion.attitude).as_matrix())
    ahead = block_means(turn[:, :2, 0], block)[good]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    forces = [block_means(each, block)[good] for each in _pushes(motion, turn)]
    return _fitted(forces, speed, ahead)


def _pushes(motion: EvenFlight, turn: Array) -> list[Array]:
    """Return the horizontal force per mass in map (N, 2): by the poses, by the accelerometer.

    `turn`: rotation matrices (N, 3, 3) of the attitude, map from body.
    """
    up = turn[:, :, 2]
    lift = (motion.acceleration[:, 2] + GRAVITY) / np.maximum(up[:, 2], 0.2)
    by_source = [motion.acceleration[:, :2] - lift[:, None] * up[:, :2]]
    if motion.accel.size:
        turned = np.transpose(turn[:, :2, :2], (0, 2, 1)) + 1e-9 * np.eye(2)
        by_source.append(np.linalg.solve(turned, motion.accel[:, :2, None])[..., 0])
    return by_source


def _fitted(forces: list[Array], speed: Array, ahead: Array) -> Push:
    """Fit by least squares with priors: push (2), drag, and two offsets of each source."""
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    width = 3 + 2 * len(forces)
    rows, targets = [], []
    for k, force in enumerate(forces):
        for axis in (0, 1):
            row = np.zeros((len(speed), width))
            row[:, axis] = 1.0
            row[:, 2] = -speed[:, axis]
            row[:, 3 + 2 * k], row[:, 4 + 2 * k] = ahead[:, axis], left[:, axis]
            rows.append(row)
            targets.append(force[:, axis])
    prior = np.array([_FASTEST_AIR, _FASTEST_AIR, USUAL_DRAG, *[_LEANS] * (width - 3)])
    design, target = np.vstack(rows), np.concatenate(targets)
    noise = 0.05
    for _ in range(3):  # the noise is that of the residual; sources see one force, not two
        weight = _BLOCK_S / (_CORRELATED_S * len(forces) * noise)
        covariance = np.linalg.inv(weight * design.T @ design + np.diag(prior**-2.0))
        value = covariance @ (weight * design.T @ target)
        rest = target - design @ value
        noise = max(float(np.mean(rest**2)), 1e-4)
    spread = covariance[:2, :2] + _FRAME_LEANS**2 * np.eye(2)
    along = value[:2] / max(float(np.linalg.norm(value[:2])), 1e-9)
    return Push(
        value[:2], math.sqrt(float(along @ spread @ along)), float(value[2]),
        math.sqrt(float(covariance[2, 2])), float(np.sqrt(np.mean(np.sum(speed**2, axis=1)))),
    )  # fmt: skip

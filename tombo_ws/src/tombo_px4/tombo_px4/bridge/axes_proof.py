"""The proof of the axes by moving the vehicle by hand: body and world, handedness, delay.

At rest gravity tells which way is up and nothing else. While the vehicle is turned, the gyro says
about which axis and when: that gives the axes of the tracked body. With them the accelerometer
gives the world's up, and while the vehicle is carried, along which axes the positions move. The
remainder is the world's heading: PX4 takes it from the poses too, so it does no harm. Proofs are
kept in a YAML list that only grows.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import body_to_map, unwrap_quaternions
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.bridge_params import SIMULATED
from tombo_px4.bridge.pose_motion import GRID_S, fit_axes, second_differences, sum_motion


@dataclass(frozen=True)
class AxesEvidence:
    """Result of a motion by hand on the axes of a tracked body.

    Attributes:
        date: UTC, ISO 8601.
        body: name of the tracked body, as the bridge's parameter says.
        vehicle: hardware id of its autopilot.
        mistake: fault of the axes; empty: they are right.
        tilt_rad: of the body's z against gravity at rest, about the vehicle's y and x.
    """

    date: str
    body: str
    vehicle: str
    mistake: str = ""
    tilt_rad: list[float] = field(default_factory=list)


def valid_proof(proofs: Iterable[AxesEvidence], vehicle: str) -> AxesEvidence | None:
    """Return the last record of a vehicle, by its hardware id; None without one, or a mistake."""
    last = [e for e in proofs if vehicle and e.vehicle == vehicle][-1:]
    return last[0] if last and not last[0].mistake else None


_DEFAULT = Path("tombo/px4_axes.yaml")


class AxesFile:
    """Reads and adds to the file; without one where the poses are simulated."""

    def __init__(self, axes_evidence: str) -> None:
        """Name the file by the bridge's parameter `axes_evidence`."""
        base = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
        named = Path(axes_evidence).expanduser() if axes_evidence else base / _DEFAULT
        self._path = None if axes_evidence == SIMULATED else named

    def of_body(self, body: str) -> tuple[AxesEvidence, ...]:
        """Return all records of a named body, the oldest first; none for a body without a name.

        Raises:
            InputError: the file can't be read, or holds something else.
        """
        if self._path is None or not self._path.is_file():
            return ()
        try:
            entries = yaml.safe_load(self._path.read_text(encoding="utf-8")) or []
            records = [_read_record(entry) for entry in entries]
        except (OSError, ValueError, yaml.YAMLError, TypeError, AttributeError, KeyError):
            raise InputError(
                f"px4.axes_evidence '{self._path}': no list of proofs of axes; accepted: the file"
                " that the bridge writes"
            ) from None
        return tuple(e for e in records if body and e.body == body)

    def add(self, evidence: AxesEvidence) -> str:
        """Add a record; return where, as the end of a sentence.

        Raises:
            InputError: the file can't be written.
        """
        if self._path is None:
            return ""
        if not (evidence.body and evidence.vehicle):
            return ", for this run alone: px4.tracked_body, or PX4's hardware id, has no name"
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(
                    yaml.safe_dump(
                        [asdict(evidence) | {"tilt_rad": list(evidence.tilt_rad)}], sort_keys=False
                    )
                )
        except OSError as error:
            raise InputError(
                f"px4.axes_evidence '{self._path}': can't be written ({error.strerror}); accepted:"
                " a file that can"
            ) from None
        return f", kept in {self._path}"


def _read_record(entry: dict[str, Any]) -> AxesEvidence:
    """Return the record of an entry of the file; entries may hold more than it.

    Raises:
        KeyError: a value is missing.
        ValueError: it proves axes without a tilt.
    """
    values = {name.name: entry[name.name] for name in fields(AxesEvidence)}
    tilt = [float(angle) for angle in values["tilt_rad"]]
    if not values["mistake"] and len(tilt) != 2:
        raise ValueError("tilt_rad")
    return AxesEvidence(**values | {"tilt_rad": tilt})


TURN_RAD, CARRY_M = 1.0, 1.0
"""Least motion of the proof about each axis, and along each axis."""
HAND_NS = 40_000_000_000
"""Motion of this age counts [ns]."""
TURNING = 0.3
"""[rad/s]: slower counts as rest."""
_LEAST_TURNED_RAD = 1.0
"""[rad] turned in all."""
_AGREES = 0.25
"""Share of the rotation that may stay unexplained."""
_MOVES_AGREE = 0.7
"""Correlation of positions and accelerometer, in all and along each direction: hands turn the
vehicle about other points."""
_CLEARER = 0.5
"""The residual of other axes must be below this share of the residual of the plain ones."""
_MIRRORED = -2.5
"""Trace of axes that are all turned round, within 24 deg."""
_SCALE_OFF = 0.25
"""Motion of positions over that of the accelerometer may be off by this."""
_UNEXPLAINED = (
    "poses turn otherwise than PX4's gyro: the quaternion is w first (let the driver fill x, y, z,"
    " w) or inverse (it must turn base_link into map), or another body is tracked, or its markers"
    " move"
)


class HandVerdict(NamedTuple):
    """Result of a motion by hand.

    Attributes:
        rotated: angle about each axis of the autopilot, to and fro [rad].
        carried: path along each axis of map, to and fro [m].
        least_carried: path along the direction with the shortest path, to and fro [m].
        delay_s: delay of the poses before their stamps; NaN: it was turned too little to tell.
        mistake: fault of the axes, in words; "" without a fault.
        sure: False: they turn otherwise, and no known mistake explains how.
        moves: the positions were compared with the accelerometer along each axis.
    """

    rotated: tuple[float, ...]
    carried: tuple[float, ...]
    least_carried: float
    delay_s: float = math.nan
    mistake: str = ""
    sure: bool = True
    moves: bool = False

    @property
    def proven(self) -> bool:
        """Axes of body and world are right, as gyro and accelerometer say."""
        return not self.mistake and self.moves and min(self.rotated) >= TURN_RAD


def judge_hand_motion(poses: Any, imu: Any, angle_max: float) -> HandVerdict | None:
    """Return the result of a motion by hand; None: the vehicle was not turned enough to tell.

    Args:
        poses: samples `POSE` of the motion.
        imu: samples `IMU` of the same time.
        angle_max: the axes may be off by this [rad].
    """
    if len(imu) < 50 or len(poses) < 20:
        return None
    begin_ns, rates = imu["stamp_ns"][0], imu["gyro"]
    gyro_times, times = ((s["stamp_ns"] - begin_ns) * 1e-9 for s in (imu, poses))
    steps, speed = np.diff(gyro_times), np.linalg.norm(rates[1:], axis=1)
    fast = speed > TURNING
    if float(speed[fast] @ steps[fast]) < _LEAST_TURNED_RAD:
        return None
    rotated = tuple((np.abs(rates[1:]) * steps[:, None])[fast].sum(axis=0).tolist())
    verdict = HandVerdict(rotated, *_carried(poses["position"]))
    if min(rotated) < TURN_RAD:
        return verdict
    fit = fit_axes(gyro_times, rates, times, poses["attitude"])
    if math.isinf(fit.left):
        return None
    if fit.left > _AGREES:
        return verdict._replace(mistake=_UNEXPLAINED, sure=False)
    axes = np.eye(3) if _angle(fit.axes) <= angle_max else fit.axes
    motion = _compare_motion(times - fit.delay_s, poses, gyro_times, imu["accel"] @ axes.T)
    return verdict._replace(
        delay_s=fit.delay_s,
        mistake=_explain(axes, motion, angle_max),
        moves=motion.compared and verdict.least_carried >= CARRY_M,
    )


class _PositionMotion(NamedTuple):
    """Motion of the positions against the accelerometer turned by the attitudes.

    Attributes:
        up: direction of up in the mocap's world.
        axes: (3, 3) turns accelerations into those of the positions, and may mirror them; None:
            the motion was too small to tell.
        scale: motion of the positions over that of the accelerometer.
        scale_error: three standard errors of it.
        agrees: positions agree along each principal direction of the motion.
    """

    up: Array
    axes: Array | None = None
    scale: float = 1.0
    scale_error: float = math.inf
    agrees: bool = False

    @property
    def wrong_scale(self) -> bool:
        """The scale is surely wrong."""
        return abs(self.scale - 1.0) - self.scale_error > _SCALE_OFF

    @property
    def compared(self) -> bool:
        """The positions agree, and their scale is surely right."""
        return self.agrees and max(abs(self.scale - 1.0), self.scale_error) < _SCALE_OFF


def _compare_motion(times: Array, poses: Any, felt_times: Array, force: Array) -> _PositionMotion:
    """Compare the second differences of positions with the accelerometer.

    Args:
        times: (N) of the capture of the poses [s].
        poses: (N) samples `POSE`.
        felt_times: (K) of the accelerometer [s].
        force: (K, 3) specific force, in the axes of the tracked body.
    """
    inside = (felt_times >= times[0]) & (felt_times <= times[-1])
    felt_times, force = felt_times[inside], force[inside]
    steady = unwrap_quaternions(poses["attitude"])
    between = np.stack([np.interp(felt_times, times, q) for q in steady.T], axis=1)
    between /= np.maximum(np.linalg.norm(between, axis=1, keepdims=True), 1e-9)
    felt = body_to_map(between, force)
    mean = felt.mean(axis=0)
    up = mean / max(float(np.linalg.norm(mean)), 1e-9)
    seen, wanted, _ = second_differences(times, poses["position"], felt_times, felt - GRAVITY * up)
    known = _PositionMotion(up)
    W, S = float((wanted**2).sum()), float((seen**2).sum())
    if len(seen) < 50 or min(W, S) <= 0.0:
        return known
    left, stretch, right = np.linalg.svd(seen.T @ wanted)
    axes, product = left @ right, float(stretch.sum())
    plain = max(float((seen * wanted).sum()), 0.0)
    same = S * W - product**2 > _CLEARER * (S * W - plain**2)
    if same:
        axes, product = np.eye(3), plain
    if product < _MOVES_AGREE * math.sqrt(S * W):
        return known
    weight_s = np.full(len(seen), GRID_S)
    sums = sum_motion(seen @ axes, wanted, weight_s)
    # a vehicle carried along a diagonal alone would agree along exchanged axes, too
    _, directions = np.linalg.eigh(wanted.T @ wanted)
    s, w = seen @ directions, wanted @ directions
    size = np.sqrt((s**2).sum(axis=0) * (w**2).sum(axis=0))
    agrees = same and bool(((s * w).sum(axis=0) >= _MOVES_AGREE * size).all())
    return _PositionMotion(up, axes, sums.slope, sums.error, agrees)


def _carried(position: Array) -> tuple[tuple[float, ...], float]:
    """Return the way to and fro along each axis (3), and along the weakest direction [m].

    Positions (N, 3) are thinned, so that their noise adds nothing.
    """
    steps = np.diff(position[:: max(len(position) // 400, 1)], axis=0)
    _, directions = np.linalg.eigh(steps.T @ steps)
    way = tuple(np.abs(steps).sum(axis=0).tolist())
    return way, float(np.abs(steps @ directions).sum(axis=0).min())


def _angle(axes: Array) -> float:
    return math.acos(min(max(0.5 * (float(np.trace(axes)) - 1.0), -1.0), 1.0))


def _explain(axes: Array, motion: _PositionMotion, angle_max: float) -> str:
    """Return in words what is wrong with the axes of body, world and position; "" if nothing is.

    Turning is an axial vector: a mirror turns it round, and the up that attitudes show with it.
    """
    moves = motion.axes
    mirrored = moves is not None and float(np.trace(moves)) < _MIRRORED
    parts = []
    if mirrored:
        parts.append("mocap attitude is mirrored: let the driver send right-handed ENU and FLU")
    elif not np.array_equal(axes, np.eye(3)):
        x, y, z = Rotation.from_matrix(axes.T).as_rotvec() / max(_angle(axes), 1e-9)
        parts.append(
            f"the rigid body is turned by {math.degrees(_angle(axes)):.0f} deg about ({x:z.1f},"
            f" {y:z.1f}, {z:z.1f}) against the autopilot: define it with x to the nose and z up"
        )
    x, y, z = -motion.up if mirrored else motion.up
    if z < math.cos(angle_max) and (moves is not None or not parts):
        parts.append(
            f"up in the mocap's world is ({x:z.1f}, {y:z.1f}, {z:z.1f}), not +z: set the streamed"
            " up axis to Z (OptiTrack Motive: Streaming, Up Axis), or the ground plane again"
        )
    if motion.wrong_scale:
        parts.append(
            f"positions move {motion.scale:.2g} times as far as PX4's accelerometer measures:"
            " unit or scale of the motion capture; poses are in metres"
        )
    if moves is not None and not mirrored and not np.array_equal(moves, np.eye(3)):
        parts.append(
            "mocap positions move along other axes than the attitude says: let the driver turn"
            " position and attitude alike, into right-handed ENU"
        )
    return "; ".join(parts)

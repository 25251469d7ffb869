"""Residuals of a flight's channels after the model's prediction, for any parameters.

Every channel is measured minus predicted, both through the same kernel. Errors of motion capture
are undone on the measured poses with the function that simulates them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from tombo_diagnosis.flight.fit.track import WIND, Track, smoothed
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY, Stage
from tombo_dynamics.effects.compose import layout, null_theta
from tombo_dynamics.rotation import conjugate, quaternion_multiply, unwrap_quaternions
from tombo_dynamics.rotor_maps import speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import CROSSOVER_WIDTH, IMU_WIDTH, POSE_WIDTH, smooth
from tombo_sim.inverse_simulation import ImposedTick, run_along_motion, simulate_mocap

NO_NOISE = np.zeros((1, 9))
"""No noise."""
_AXES = ("x", "y", "z")
OF_POSES = sorted(
    index
    for name, effect in REGISTRY.items()
    if effect.stage is Stage.MOCAP
    for index in layout()[name].values()
)
"""Places in theta of the parameters that act on the poses."""
_NULL = null_theta()


@dataclass(frozen=True)
class ChannelId:
    """A channel of residuals."""

    name: str
    unit: str


_GROUPS = {
    "force": "force", "acceleration": "force", "turning": "moment", "rotor speed": "rotor speed",
    "latency": "clock", "gyro against mocap": "gyro and motion capture",
    "mocap against accel": "accelerometer and motion capture", "voltage": "supply",
}  # fmt: skip


def channel_group(channel: str) -> str:
    """Return the quantity of a channel: force, moment, rotor speed, clock, a pair of sensors."""
    return next(group for start, group in _GROUPS.items() if channel.startswith(start))


@dataclass(frozen=True)
class MotionOfPoses:
    """The motion behind measured poses, at the ticks."""

    state: Array
    """(N, 16) position, velocity, quaternion, body rates, angular acceleration: the inputs of the
    model."""
    position: Array
    """(N, 3) between the poses, not smoothed: it is what is compared with the model [m]."""
    rates: Array
    """(N, 3) body rates from the attitude alone [rad/s]."""
    rotation: Array
    """(N, 3, 3) map from body."""
    pose_latency: Array
    """(M,) latency that the model gives each pose, against its stamp [s]."""


def channels_of(track: Track, nominal: NominalModel) -> dict[str, list[ChannelId]]:
    """Return group of rows (fast, slow, pose) -> its channels, in the order of `residuals`."""
    driven = bool(track.command.size or track.speed.size)
    imu = track.formulation == "imu"
    rotors: list[ChannelId] = []
    if nominal.moments and (driven or not imu):
        rotors += [ChannelId(f"turning {a}", "rad/s^2") for a in _AXES]
    if track.speed.size and track.command.size:
        rotors += [ChannelId(f"rotor speed {i}", "rad/s") for i in range(1, 5)]
    groups: dict[str, list[ChannelId]] = {}
    if imu:
        force = _AXES if driven else _AXES[:2]
        groups["fast"] = [*(ChannelId(f"force {a}", "m/s^2") for a in force), *rotors]
        groups["slow"] = [ChannelId(f"mocap against accel {a}", "m/s^2") for a in _AXES]
        groups["slow"] += [ChannelId(f"gyro against mocap {a}", "rad/s") for a in _AXES]
    else:
        groups["slow"] = [*(ChannelId(f"acceleration {a}", "m/s^2") for a in _AXES), *rotors]
    if track.voltage.size and not nominal.calibrated:
        groups["slow"].append(ChannelId("voltage", "V"))
    if track.arrival.size:
        groups["pose"] = [ChannelId("latency", "s")]
    return groups


def motion_of(track: Track, nominal: NominalModel, theta: Array) -> MotionOfPoses:
    """Return the motion that, seen by this motion capture, gives the measured poses."""
    plant = nominal.plant()
    spacing = float(np.median(np.diff(track.pose_t)))
    guess: Array = track.pose.copy()
    seen: Array = np.zeros((guess.shape[0], 10))
    # The frame's errors are a turn and a shift, alike for all poses: the second step is exact.
    axes = np.hstack([np.eye(4, 3, -1), np.zeros((4, 3)), np.ones((4, 1))])
    seen_axes = simulate_mocap(plant, theta, NO_NOISE, axes, spacing)[:, :3]
    back = np.linalg.inv(seen_axes[1:] - seen_axes[0])
    for _ in range(3 if np.any(theta[OF_POSES] != _NULL[OF_POSES]) else 1):
        seen = simulate_mocap(plant, theta, NO_NOISE, guess, spacing)
        guess[:, :3] += (track.pose[:, :3] - seen[:, :3]) @ back
        inverse = conjugate(seen[:, 3:7])
        guess[:, 3:] = quaternion_multiply(
            quaternion_multiply(track.pose[:, 3:], inverse), guess[:, 3:]
        )
    guess[:, 3:] = unwrap_quaternions(guess[:, 3:])
    spline = CubicSpline(track.pose_t - seen[:, 9], guess)
    value = spline(track.t)
    rate = spline(track.t, 1)
    q = value[:, 3:]
    length = np.linalg.norm(q, axis=1, keepdims=True)
    q = q / length
    rotation = Rotation.from_quat(q).as_matrix()
    turn = quaternion_multiply(conjugate(q), rate[:, 3:] / length)
    rates = 2.0 * turn[:, :3]
    # The gyro is the better one; its error is compared in a separate channel.
    body = track.gyro if track.gyro.size else rates
    turning = smooth(body, IMU_WIDTH, track.step, order=1)
    state = np.column_stack([*_smooth_path(track, value[:, :3], rotation), q, body, turning])
    return MotionOfPoses(state, value[:, :3], rates, rotation, seen[:, 7] - seen[:, 9])


def _smooth_path(track: Track, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Return position and velocity, (N, 3) each, with little of the noise of the poses.

    Slow motion is that of the poses, quick motion that of the accelerometer, integrated twice.
    Where a force follows the velocity or stretches a thread, noise of the poses is noise of the
    regressors. The fitted value would then be too small.
    """
    tick = track.step
    width = POSE_WIDTH / tick
    velocity_imu = position_imu = np.zeros_like(position)
    if track.formulation == "imu":
        width = CROSSOVER_WIDTH / tick
        force = np.einsum("nij,nj->ni", rotation, track.accel)
        velocity_imu = cumulative_trapezoid(
            force - np.array([0.0, 0.0, GRAVITY]), dx=tick, axis=0, initial=0.0
        )
        position_imu = cumulative_trapezoid(velocity_imu, dx=tick, axis=0, initial=0.0)
    slow = smoothed(position - position_imu, width)
    return position_imu + slow, velocity_imu + np.gradient(slow, tick, axis=0)


_SWING = [layout()[WIND][n] for n in ("swing_east", "swing_north", "frequency", "phase")]


def with_air(track: Track, theta: Array) -> Array:
    """Return theta with the swing of the air that a flight has."""
    swing = track.swing
    if swing is None:
        return theta
    moved = theta.copy()
    moved[_SWING] = swing.east, swing.north, swing.frequency, swing.phase
    return moved


def simulate_along_motion(
    track: Track,
    nominal: NominalModel,
    theta: Array,
    motion: MotionOfPoses,
    draws: Array | None = None,
    noise: Array = NO_NOISE,
) -> Any:
    """Run the model along the motion; (N,) `tombo_sim.inverse_simulation.ImposedTick`."""
    out = np.zeros(track.t.size, ImposedTick.layout)
    command = track.command if track.command.size else track.speed[:, :4]
    if not command.size:
        hover = speed_for_thrust(nominal.maps, nominal.vehicle.hover_thrust())
        command = np.full((track.t.size, 4), hover)
    run_along_motion(
        nominal.plant(draws), nominal.maps, with_air(track, theta), noise, track.step,
        motion.state, command, track.speed, out,
    )  # fmt: skip
    return out


def residuals(
    track: Track,
    nominal: NominalModel,
    theta: Array,
    motion: MotionOfPoses | None = None,
    draws: Array | None = None,
    noise: Array = NO_NOISE,
) -> dict[str, Array]:
    """Return residuals of each group's channels, (rows, channels), for the valid rows.

    `motion`: of these parameters, where it is known already; `draws`: (8) standard normals of the
    vehicle, None: zeros; `noise`: (K, 9) standard normals for the effects that take some.
    """
    motion = motion or motion_of(track, nominal, theta)
    model = simulate_along_motion(track, nominal, theta, motion, draws, noise)
    driven = bool(track.command.size or track.speed.size)
    imu = track.formulation == "imu"
    kernel = track.fast_kernel if imu else track.slow_kernel
    body = track.gyro - model["gyro_error"] if imu else motion.rates
    rotors = []
    if nominal.moments and (driven or not imu):
        rotors.append(kernel.slope @ body - kernel.smooth @ model["angular_acceleration"])
    if track.speed.size and track.command.size:
        rotors.append(kernel.smooth @ (track.speed[:, :4] - model["rotor_speed"]))
    smooth = track.slow_kernel.smooth
    seen = track.slow_kernel.curvature @ motion.position
    if imu:
        accel = track.accel - model["accel_error"]
        in_map = np.einsum("nij,nj->ni", motion.rotation, accel) - np.array([0.0, 0.0, GRAVITY])
        slow = [seen - smooth @ in_map, smooth @ (body - motion.rates)]
    else:
        slow = [seen - smooth @ model["acceleration"], *rotors]
    if track.voltage.size and not nominal.calibrated:
        slow.append(smooth @ (track.voltage - model["voltage"]))
    result = {"slow": np.column_stack(slow)}
    if imu:
        residual = track.accel - (model["force"] + model["accel_error"])
        force = kernel.smooth @ (residual if driven else residual[:, :2])
        result["fast"] = np.column_stack([force, *rotors])
    if track.arrival.size:
        result["pose"] = (track.arrival - motion.pose_latency)[track.pose_rows, None]
    return result

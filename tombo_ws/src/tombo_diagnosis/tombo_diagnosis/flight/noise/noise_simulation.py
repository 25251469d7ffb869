"""What noise alone leaves in each channel: one draw of all noise that the model knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tombo_diagnosis.flight.fit.prediction import NO_NOISE, residuals
from tombo_diagnosis.flight.fit.track import TICK, Track
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply
from tombo_sim.inverse_simulation import simulate_mocap

_SAMPLE = 0.001
"""s: noise of the IMU is given for samples of 1 kHz; a tick is the mean of several."""


def with_pose_noise(track: Track, nominal: NominalModel, theta: Array, seed: int) -> Track:
    """Return a track whose poses have the noise of the model once more, drawn by a seed."""
    spacing = float(np.median(np.diff(track.pose_t)))
    drawn = np.random.default_rng([seed, 1]).standard_normal((track.pose.shape[0], 9))
    quiet = simulate_mocap(nominal.plant(), theta, NO_NOISE, track.pose, spacing)
    noisy = simulate_mocap(nominal.plant(), theta, drawn, track.pose, spacing)
    pose = track.pose.copy()
    pose[:, :3] += noisy[:, :3] - quiet[:, :3]
    inverse = conjugate(quiet[:, 3:7])
    pose[:, 3:] = quaternion_multiply(quaternion_multiply(noisy[:, 3:7], inverse), pose[:, 3:])
    arrival = track.arrival
    if arrival.size:
        arrival = arrival + noisy[:, 7] - quiet[:, 7]
    return replace(track, pose=pose, arrival=arrival)


def simulated_noise(
    track: Track, nominal: NominalModel, theta: Array, seed: int
) -> dict[str, Array]:
    """Return a draw of the noise in each group's channels, (rows, channels), the motion kept."""
    rng = np.random.default_rng(seed)
    residual = residuals(track, nominal, theta)
    noise = rng.standard_normal((track.t.size, 9))
    noise[:, 3:] *= np.sqrt(_SAMPLE / TICK)
    moved = with_pose_noise(track, nominal, theta, seed)
    drawn = residuals(moved, nominal, theta, noise=noise)
    return {group: drawn[group] - residual[group] for group in residual}

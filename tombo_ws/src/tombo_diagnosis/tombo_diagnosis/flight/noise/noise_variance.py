"""How noisy a channel's rows are, correlation included, and how far they can be trusted at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tombo_diagnosis.flight.fit.prediction import NO_NOISE, residuals
from tombo_diagnosis.flight.fit.track import TICK, Track
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply
from tombo_logs.checks.spans import block_means
from tombo_sim.inverse_simulation import simulate_mocap

SCALES_S = (0.12, 0.24, 0.48, 0.96, 1.92, 3.84)
"""Lengths of the blocks."""


def block_variances(residual: Array, spacing: float) -> tuple[Array, Array]:
    """Return variances (scales, channels) of half differences of adjacent block means, and counts.

    Constants give nothing, a slow drift little: each scale sees what changes within it (Haar
    wavelet variance, as Allan's). `residual` is (rows, channels), a row each `spacing` seconds.
    """
    variances = np.full((len(SCALES_S), residual.shape[1]), np.nan)
    counts = np.zeros(len(SCALES_S))
    for k, scale in enumerate(SCALES_S):
        length = max(1, round(scale / spacing))
        blocks = residual.shape[0] // length
        if blocks < 4 or length * spacing > 1.5 * scale:
            continue
        half = 0.5 * np.diff(block_means(residual, length), axis=0)
        variances[k] = np.mean(half**2, axis=0)
        counts[k] = blocks / 1.5
    return variances, counts


def pooled(found: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return variances and counts over flights, weighed by the counts."""
    counts = np.sum([c for _, c in found], axis=0)
    total = np.zeros_like(found[0][0])
    for variances, count in found:
        total += np.where(count[:, None] > 0, np.nan_to_num(variances) * count[:, None], 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / counts[:, None]
    return mean, counts


def long_run_of_scales(variances: Sequence[float], per_second: float) -> float:
    """Return rows times the variance of their mean, at the time scale where this is most.

    `variances`: as `block_variances` returns them for one channel, with `per_second` rows; that of
    a block's mean is twice as much.
    """
    blocks = zip(variances, SCALES_S, strict=False)
    return max((2.0 * v * scale * per_second for v, scale in blocks), default=0.0)


BLOCK_S = 1.0
"""Residuals are taken to be independent from one such block to the next."""
_SETTLES_S = 10.0
_FLOORS = {
    "force": (0.004, 0.012),
    "mocap against accel": (0.004, 0.006),
    "acceleration": (0.004, 0.012),
    "turning": (0.02, 0.04),
    "gyro against mocap": (0.0005, 0.0012),
    "rotor speed": (0.3, 0.4),
    "voltage": (0.005, 0.01),
    "latency": (1e-4, 2e-4),
}
"""By the beginning of a channel's name, in its unit: no average over ten seconds is trusted to be
closer than the first, however still the data look; the second is the least error of the model."""


def floors_of(channel: str) -> tuple[float, float]:
    """Return how close an average of a channel can be trusted to be, and the model's error."""
    return next(floors for start, floors in _FLOORS.items() if channel.startswith(start))


def long_run_variance(residual: Sequence[Array], per_second: float, floor: float) -> float:
    """Return what correlated noise amounts to: rows times the variance of their mean.

    `residual` (rows,) is what no candidate explains of each flight; `floor`: see `floors_of`.
    """
    per_block = max(1, round(BLOCK_S * per_second))
    sums = []
    for rows in residual:
        count = rows.size // per_block
        centred = rows - rows.mean() if rows.size > 2 * per_block else rows
        sums.append(centred[: count * per_block].reshape(count, per_block).sum(axis=1))
    blocks = np.concatenate(sums)
    white = float(np.mean(np.concatenate(residual) ** 2))
    coloured = float(np.mean(blocks**2)) / per_block if blocks.size >= 3 else white
    return max(coloured, white, floor**2 * per_second * _SETTLES_S)


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

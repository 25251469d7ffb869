"""Cross-validated R² of a remainder: how much of it the state of the vehicle predicts.

Gusts do not repeat; an unknown force that depends on place, speed, heading or time does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.prediction import Motion
from tombo_diagnosis.flight.fit.problem import FlightProblem, tangent_of
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_logs.checks.spans import block_means

_BLOCK_S = 0.48
"""Means over such blocks are looked at: noise of the sensors is no gust."""
_MIN_SPEED, _MIN_BLOCKS = 0.3, 12
"""m/s, and blocks of a flight that are faster: only these are looked at, if there are enough."""
_SPOTS = 4
"""Spots of the grid, along and across."""
_FOLDS = 3
"""Blocks of a single flight that stand for flights."""


def features(motion: Motion, t: Array, low: Array, high: Array) -> Array:
    """Return (N, k): smooth functions of place, speed, heading, turning and time (N) of a flight.

    `low` and `high` (3) bound the places of all flights: spots are the same for all of them.
    """
    state = motion.state
    body = np.einsum("nji,nj->ni", motion.rotation, state[:, 3:6])
    speed = np.linalg.norm(body, axis=1, keepdims=True)
    disc = body[:, :2] / np.maximum(np.linalg.norm(body[:, :2], axis=1, keepdims=True), 0.05)
    way = state[:, 3:5] / np.maximum(np.linalg.norm(state[:, 3:5], axis=1, keepdims=True), 0.05)
    place = state[:, :3] - 0.5 * (low + high)
    yaw = yaw_pitch_roll(state[:, 6:10])[:, :1]
    clock = (t - t[0])[:, None] / 10.0
    parts = [
        body, np.sign(body) * np.sqrt(np.abs(body)), body * speed, body**2, place, place**2,
        place[:, :1] * place[:, 1:2], np.exp(-np.maximum(state[:, 2:3], 0.0)), np.sin(yaw),
        np.cos(yaw), state[:, 10:13], clock, state[:, 3:6], disc, way,
        _grid_features(state, low, high),
    ]  # fmt: skip
    return np.column_stack(parts)


def _grid_features(state: Array, low: Array, high: Array) -> Array:
    """Return (N, k): how near the vehicle is to each of a grid of spots on the ground."""
    spacing = np.maximum((high - low)[:2] / (_SPOTS - 1), 0.1)
    grid = [low[i] + spacing[i] * np.arange(_SPOTS) for i in (0, 1)]
    near = [np.exp(-0.5 * ((state[:, i, None] - grid[i]) / spacing[i]) ** 2) for i in (0, 1)]
    both = near[0][:, :, None] * near[1][:, None, :]
    return np.asarray(both.reshape(both.shape[0], -1))


def cross_validated_r2(problem: FlightProblem, fit: Fit, start: tuple[str, ...]) -> float:
    """Return the share (0 to 1) of the remainder of a fit that other flights predict.

    Of the channels whose names begin with one of `start`.
    """
    xs, ys = [], []
    motions = [linear.motion for linear in tangent_of(fit).linears]
    places = np.vstack([motion.state[:, :3] for motion in motions])
    low, high = places.min(axis=0), places.max(axis=0)
    for f, (track, motion) in enumerate(zip(problem.tracks, motions, strict=True)):
        every = features(motion, track.t, low, high)
        for group, rows in problem.residual(fit, f).items():
            own = problem.channels[f][group]
            chosen = [j for j, c in enumerate(own) if c.name.startswith(start)]
            if not chosen:
                continue
            kernel = track.fast_kernel if group == "fast" else track.slow_kernel
            x = kernel.smooth @ every
            step = max(1, round(_BLOCK_S * problem.per_second(group)))
            # At rest a force against the motion has the direction of the pose's noise.
            moving = block_means(kernel.smooth @ motion.state[:, 3:6], step)
            fast = np.linalg.norm(moving, axis=1) > _MIN_SPEED
            kept = fast if np.count_nonzero(fast) > _MIN_BLOCKS else np.ones(fast.size, np.bool_)
            xs.append(block_means(x, step)[kept])
            ys.append(block_means(rows[:, chosen], step)[kept])
    if len(xs) == 1:
        xs = np.array_split(xs[0], _FOLDS)
        ys = np.array_split(ys[0], _FOLDS)
    scale = np.maximum(np.vstack(xs).std(axis=0), 1e-9)
    xs = [x / scale for x in xs]
    # With and without the spots: a force at large needs none, and they dilute what it shows.
    return max(_held_out_r2([x[:, :last] for x in xs], ys) for last in (-(_SPOTS**2), None))


def _held_out_r2(xs: Sequence[Array], ys: Sequence[Array]) -> float:
    """Return the share of the variance in `ys` that a ridge over the other flights predicts."""
    before = after = 0.0
    for k in range(len(xs)):
        x = np.vstack([v for i, v in enumerate(xs) if i != k])
        y = np.vstack([v for i, v in enumerate(ys) if i != k])
        x = np.column_stack([np.ones(x.shape[0]), x])
        penalty = 0.2 * x.shape[0] * np.eye(x.shape[1])
        weights = np.linalg.solve(x.T @ x + penalty, x.T @ y)
        guess = np.column_stack([np.ones(xs[k].shape[0]), xs[k]]) @ weights
        before += float(np.sum(ys[k] ** 2))
        after += float(np.sum((ys[k] - guess) ** 2))
    return max(0.0, 1.0 - after / before) if before > 0.0 else 0.0

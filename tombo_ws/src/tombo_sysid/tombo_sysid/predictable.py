"""How much of a remainder the vehicle's state foretells in flights that it was not learned from.

Gusts do not repeat; an unknown force that depends on place, speed, heading or time does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_sysid.prediction import Motion, motion_of
from tombo_sysid.problem import Fit, Problem
from tombo_sysid.spectra import block_means

Array = NDArray[np.float64]

_BLOCK_S = 0.48
"""Means over such blocks are looked at: noise of the sensors is no gust."""
_MOVES, _ENOUGH = 0.3, 12
"""m/s, and blocks of a flight that are faster: only these are looked at, if there are enough."""
_FOLDS = 3
"""Blocks of a single flight that stand for flights."""


def features(motion: Motion, t: Array) -> Array:
    """Return (N, k): smooth functions of place, speed, heading, turning and time."""
    state = motion.state
    body = np.einsum("nji,nj->ni", motion.rotation, state[:, 3:6])
    speed = np.linalg.norm(body, axis=1, keepdims=True)
    disc = body[:, :2] / np.maximum(np.linalg.norm(body[:, :2], axis=1, keepdims=True), 0.05)
    way = state[:, 3:5] / np.maximum(np.linalg.norm(state[:, 3:5], axis=1, keepdims=True), 0.05)
    place = state[:, :3] - state[:, :3].mean(axis=0)
    yaw = yaw_pitch_roll(state[:, 6:10])[:, :1]
    clock = (t - t[0])[:, None] / 10.0
    parts = [
        body, np.sign(body) * np.sqrt(np.abs(body)), body * speed, body**2, place, place**2,
        place[:, :1] * place[:, 1:2], np.exp(-np.maximum(state[:, 2:3], 0.0)), np.sin(yaw),
        np.cos(yaw), state[:, 10:13], clock, state[:, 3:6], disc, way,
    ]  # fmt: skip
    return np.column_stack(parts)


def foretold(problem: Problem, fit: Fit, start: tuple[str, ...]) -> float:
    """Return the share (0 to 1) of the remainder's variance that other flights foretell.

    Args:
        problem: the flights.
        fit: the explanation whose remainder is looked at.
        start: beginnings of the names of the channels to look at.
    """
    xs, ys = [], []
    for f, track in enumerate(problem.tracks):
        motion = motion_of(track, problem.nominal, fit.theta)
        every = features(motion, track.t)
        for group, rows in problem.left(fit, f).items():
            own = [c for c in problem.channels[f] if c.group == group]
            chosen = [j for j, c in enumerate(own) if c.name.startswith(start)]
            if not chosen:
                continue
            kernel = track.fast_kernel if group == "fast" else track.slow_kernel
            x = kernel.smooth @ every
            step = max(1, round(_BLOCK_S * problem.per_second(group)))
            # At rest a force against the motion has the direction of the pose's noise.
            moving = block_means(kernel.smooth @ motion.state[:, 3:6], step)
            fast = np.linalg.norm(moving, axis=1) > _MOVES
            kept = fast if np.count_nonzero(fast) > _ENOUGH else np.ones(fast.size, np.bool_)
            xs.append(block_means(x, step)[kept])
            ys.append(block_means(rows[:, chosen], step)[kept])
    if len(xs) == 1:
        xs = np.array_split(xs[0], _FOLDS)
        ys = np.array_split(ys[0], _FOLDS)
    scale = np.maximum(np.vstack(xs).std(axis=0), 1e-9)
    xs = [x / scale for x in xs]
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

"""Noise: how much of it a channel's rows have, and the effects that have nothing but a variance.

Stochastic effects (noise, jitter, gaps) have no mean; they are found by their variance. The
functions that simulate them are run with random draws. A few statistics of the result are
compared with the measured ones: standard deviations, shares, lengths of gaps. Each is compared as
a logarithm (or the root of a count), because the scatter of that is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.engine.regression import FreeParameter
from tombo_diagnosis.flight.fit.prediction import NO_NOISE, residuals
from tombo_diagnosis.flight.fit.track import TICK, Track
from tombo_diagnosis.flight.nominal import PARAMETERS, NominalModel
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply
from tombo_logs.checks.clocks.stamps import jitter
from tombo_logs.checks.spans import block_means
from tombo_sim.inverse_simulation import simulate_imu_at_rest, simulate_mocap

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


_DRAWN = 20_000
_IMU_RATE = (800.0, 1250.0)
"""Hz: noise of the IMU is given for samples of 1 kHz."""
_UNMODELLED = 0.03
"""Scatter of a logarithm beyond sampling: no noise is exactly as its model."""
_SAMPLING = 0.001
"""s: simulated arrivals are known to a tick."""


Statistics = dict[str, tuple[float, float]]
"""Name -> measured value and its standard deviation."""
Predict = Callable[[Array], dict[str, float]]
"""Theta -> the values that the model predicts."""


_UNEVEN = 0.1
"""Share of a step by which stamps may jitter and still be times of capture."""


@dataclass(frozen=True)
class NoiseFit:
    """One stochastic effect, fitted to the statistics."""

    effect: str
    free: tuple[int, ...]
    """Places in theta."""
    value: tuple[float, ...]
    deviation: tuple[float, ...]
    evidence: float
    """Logarithm of the Bayes factor against healthy noise."""


def imu_noise_statistics(tracks: Sequence[Track]) -> Statistics:
    """Return the white noise of gyro and accelerometer, as logarithms of standard deviations."""
    statistics = {}
    for channel in ("gyro", "accel"):
        sums, count = 0.0, 0
        for track in tracks:
            series = track.log.series.get(channel)
            if series is None or series.t.size < 1000:
                continue
            step = float(np.median(np.diff(series.t)))
            if not _IMU_RATE[0] <= 1.0 / step <= _IMU_RATE[1]:
                continue
            inside = (series.t > track.t[0]) & (series.t < track.t[-1])
            for begin, end in track.log.exclude:
                inside &= (series.t < begin) | (series.t > end)
            third = np.diff(series.values[inside], 3, axis=0)
            third = third[np.isfinite(third).all(axis=1)]
            sums += float(_robust_variance(third)) * third.size
            count += third.size
        if sums > 0.0:  # of values rounded coarsely it is 0, and says nothing
            statistics[channel] = 0.5 * math.log(sums / count / 20.0), _sigma(count)
    return statistics


def predicted_imu_statistics(nominal: NominalModel, theta: Array) -> dict[str, float]:
    """Return the same statistics, predicted by the model."""
    noise = _noise()[:4000]
    out = np.zeros((noise.shape[0], 6))
    simulate_imu_at_rest(nominal.plant(), theta, noise, out)
    third = np.diff(out, 3, axis=0)
    return {
        "gyro": _log_deviation(float(np.mean(third[:, :3] ** 2)) / 20.0),
        "accel": _log_deviation(float(np.mean(third[:, 3:] ** 2)) / 20.0),
    }


def pose_noise_statistics(tracks: Sequence[Track]) -> Statistics:
    """Return noise of the poses, jitter of their arrival, and their gaps."""
    position, attitude, delays = [], [], []
    gaps, lengths, samples = 0, [], 0
    for track in tracks:
        spacing = float(np.median(np.diff(track.pose_t)))
        captured = _capture_times(track)
        missing = lost_samples(np.diff(captured), spacing)[_in_flight(track, captured)]
        gaps += int(np.count_nonzero(missing))
        lengths += [float(m) for m in missing[missing > 0]]
        samples += missing.size + int(missing.sum())
        even = np.abs(np.diff(track.pose_t) - spacing) < 0.3 * spacing
        runs = even[:-4] & even[1:-3] & even[2:-2] & even[3:-1] & track.pose_rows[2:-3]
        fifth = np.diff(track.pose, 5, axis=0)[runs]
        position.append(fifth[:, :3])
        attitude.append(2.0 * fifth[:, 3:])
        if track.arrival.size:
            delays.append(np.diff(track.arrival)[track.pose_rows[1:]])
    statistics = {}
    every = np.vstack(position)
    if every.shape[0] > 50:
        statistics["position"] = (
            0.5 * math.log(_robust_variance(every) / 252.0),
            _sigma(every.size),
        )
        turned = np.vstack(attitude)
        # Of four components of a unit quaternion three are free.
        variance = _robust_variance(turned) * 4.0 / 3.0 / 252.0
        statistics["attitude"] = 0.5 * math.log(variance), _sigma(turned.size)
    late = np.concatenate(delays) if delays else np.zeros(0)
    if late.size > 50 and late.std() > 0.0:
        statistics["jitter"] = 0.5 * math.log(float(np.mean(late**2)) / 2.0), _sigma(late.size)
    if samples > 100 and all(_are_capture_times(track.pose_t) for track in tracks):
        statistics["gaps"] = 2.0 * math.sqrt(gaps), 1.0
        statistics["samples"] = float(samples), math.inf
        if gaps >= 5:
            mean = float(np.mean(lengths))
            spread = max(float(np.std(lengths)), 0.3) / mean / math.sqrt(gaps)
            statistics["gap length"] = math.log(mean), spread
    return statistics


def _are_capture_times(t: Array) -> bool:
    """Return whether stamps are even; where they jitter as arrivals do, a gap is not a loss."""
    return jitter(t) < _UNEVEN * float(np.median(np.diff(t)))


def lost_samples(steps: Array, spacing: float) -> NDArray[np.intp]:
    """Return how many samples are lost in each step (N,) of a clock with this spacing [s].

    A short step next to a late sample compensates it.
    """
    around = np.pad(steps, 1, constant_values=spacing)
    sums = steps, steps + around[:-2], steps + around[2:]
    counts = [np.round(total / spacing) - k for total, k in zip(sums, (1, 2, 2), strict=True)]
    return np.asarray(np.maximum(np.min(counts, axis=0), 0.0), np.intp)


def predicted_pose_statistics(
    nominal: NominalModel, theta: Array, spacing: float, samples: float
) -> dict[str, float]:
    """Return the same statistics, predicted by the model."""
    noise = _noise()
    still = np.zeros((_DRAWN, 7))
    still[:, 6] = 1.0
    seen = simulate_mocap(nominal.plant(), theta, noise, still, spacing)
    fifth = np.diff(seen[:, :7], 5, axis=0)
    dropped = seen[:, 8] > 0.0
    starts = dropped & ~np.concatenate([[False], dropped[:-1]])
    gaps = float(np.count_nonzero(starts))
    late = np.round(seen[:, 7] / _SAMPLING) * _SAMPLING
    steps = np.diff(late)
    return {
        "position": _log_deviation(float(np.mean(fifth[:, :3] ** 2)) / 252.0),
        "attitude": _log_deviation(4.0 * float(np.mean(fifth[:, 3:6] ** 2)) / 252.0),
        "jitter": _log_deviation(float(np.mean(steps**2)) / 2.0),
        "gaps": 2.0 * math.sqrt(gaps / _DRAWN * samples),
        "gap length": math.log(max(float(dropped.sum()) / gaps, 1e-3)) if gaps else 0.0,
    }


def fit_noise_effects(
    tracks: Sequence[Track], nominal: NominalModel, theta: Array
) -> list[NoiseFit]:
    """Return the stochastic effects that IMU and poses show by themselves, with their evidence."""
    spacing = float(np.median(np.diff(tracks[0].pose_t)))
    fits = []
    imu = imu_noise_statistics(tracks)
    if imu:
        fits += _fit_all(imu, lambda at: predicted_imu_statistics(nominal, at), theta)
    pose = pose_noise_statistics(tracks)
    samples, _ = pose.pop("samples", (0.0, 0.0))
    if pose:
        fits += _fit_all(
            pose, lambda at: predicted_pose_statistics(nominal, at, spacing, samples), theta
        )
    return fits


def _fit_all(statistics: Statistics, predict: Predict, theta: Array) -> list[NoiseFit]:
    """Fit every effect that changes these statistics, its parameters singly and together."""
    base = predict(theta)
    fits = []
    for effect in dict.fromkeys(p.effect for p in PARAMETERS):
        parameters = [p for p in PARAMETERS if p.effect == effect]
        moving = []
        for p in parameters:
            there = theta.copy()
            for other in parameters:
                if theta[other.index] == other.null and other is not p:
                    there[other.index] += 0.5 * other.scale
            near = predict(there)
            there[p.index] += p.scale if theta[p.index] + p.scale <= p.high else -p.scale
            far = predict(there)
            if any(abs(far[k] - near[k]) > 1e-3 for k in statistics):
                moving.append(p)
        ways = [[p] for p in moving] + ([moving] if len(moving) > 1 else [])
        fits += [_fit(effect, free, statistics, predict, theta, base) for free in ways]
    return fits


def _fit(
    effect: str,
    free: Sequence[FreeParameter],
    statistics: Statistics,
    predict: Predict,
    theta: Array,
    base: dict[str, float],
) -> NoiseFit:
    """Gauss-Newton from the size that clearly matters; evidence by Laplace's approximation."""
    sigma = np.array([math.hypot(s, _UNMODELLED) for _, s in statistics.values()])
    start = np.array([theta[p.index] for p in free])
    scales = np.array([p.scale for p in free])
    low = np.array([p.low + 1e-3 * p.scale for p in free])
    high = np.array([p.high for p in free])

    def off(model: dict[str, float]) -> Array:
        return np.asarray(np.array([v - model[k] for k, (v, _) in statistics.items()]) / sigma)

    def misfit(values: Array) -> Array:
        there = theta.copy()
        there[[p.index for p in free]] = values
        return off(predict(there))

    at = np.clip(start + 0.5 * scales, low, high)
    for _ in range(12):
        residual = misfit(at)
        slopes = np.column_stack(
            [(residual - misfit(at + step)) / step.sum() for step in np.diag(0.02 * scales)]
        )
        precision = slopes.T @ slopes + np.diag(scales**-2.0)
        step = np.linalg.solve(precision, slopes.T @ residual - (at - start) / scales**2)
        least = -0.7 * np.abs(at - low) - 0.02 * scales
        before, at = at, np.clip(at + np.clip(step, least, scales), low, high)
        if np.max(np.abs(at - before) / scales) < 1e-3:
            break
    residual = misfit(at)
    covariance = np.linalg.inv(precision)
    cost = float(residual @ residual) + float(np.sum(((at - start) / scales) ** 2))
    occam = 0.5 * float(np.linalg.slogdet(covariance)[1]) - float(np.log(scales).sum())
    evidence = -0.5 * cost + occam - _healthy_cost(off(base), slopes, [p.tolerance for p in free])
    return NoiseFit(
        effect,
        tuple(p.index for p in free),
        tuple(float(v) for v in at),
        tuple(float(v) for v in np.sqrt(np.diag(covariance))),
        evidence,
    )


def _healthy_cost(none: Array, slopes: Array, tolerances: Sequence[float]) -> float:
    """Return the log evidence of the nominal model, its parameters off by their tolerances."""
    moved = slopes * np.asarray(tolerances)
    covariance = np.eye(none.size) + moved @ moved.T
    return -0.5 * float(none @ np.linalg.solve(covariance, none)) - 0.5 * float(
        np.linalg.slogdet(covariance)[1]
    )


@lru_cache(maxsize=1)
def _noise() -> Array:
    """The same draws for every prediction: differences between two are not chance."""
    return np.random.default_rng(8).standard_normal((_DRAWN, 9))


def _capture_times(track: Track) -> Array:
    """Return the stamps of all samples (M,), those too whose position was left out as wrong."""
    attitude = track.log.series["attitude"].t
    attitude = attitude[(attitude >= track.pose_t[0]) & (attitude <= track.pose_t[-1])]
    return attitude if np.isin(track.pose_t, attitude).all() else track.pose_t


def _in_flight(track: Track, t: Array) -> NDArray[np.bool_]:
    """Return (M - 1,): steps between stamps (M,) that count: of the track, and not excluded."""
    begins, ends = t[:-1], t[1:]
    counted = track.pose_t[track.pose_rows]
    inside = (begins >= counted.min(initial=math.inf)) & (begins <= counted.max(initial=-math.inf))
    for begin, end in track.log.exclude:
        inside &= (ends < begin) | (begins > end)
    return np.asarray(inside)


def _sigma(count: int) -> float:
    return 1.0 / math.sqrt(max(count, 1))


def _log_deviation(variance: float) -> float:
    return 0.5 * math.log(max(variance, 1e-16))


def _robust_variance(values: Array) -> float:
    limit = 4.0 * np.median(np.abs(values), axis=0) / 0.6745
    return float(np.mean(np.clip(values, -limit, limit) ** 2))

"""Whether what an explanation leaves unexplained is what noise leaves: by channel and time scale.

This is the test against unknown causes. The best candidate always explains something; it is the
cause only if nothing but noise remains. Gusts are random air: force that no motion repeats and
that fades with its own time; an unknown force that depends on place, speed, heading or time
repeats, and the state of the vehicle predicts it in other flights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.prediction import MotionOfPoses, channel_group
from tombo_diagnosis.flight.fit.problem import FlightProblem, tangent_of
from tombo_diagnosis.flight.fit.sensitivity import map_flights
from tombo_diagnosis.flight.noise import SCALES_S, block_variances, floors_of, simulated_noise
from tombo_diagnosis.flight.nominal import PARAMETERS
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import layout
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_flight.vehicle_file import HealthyFlights
from tombo_logs.checks.spans import block_means

_BLOCK_S = 0.48
"""Means over such blocks are looked at, without the noise of the sensors."""
_MIN_SPEED_M_S, _MIN_BLOCKS = 0.3, 12
"""m/s, and blocks of a flight that are faster: only these are looked at, if there are enough."""
_GRID_SPOTS = 4
"""Spots of the grid, along and across."""
_FOLDS = 3
"""Blocks of a single flight that count as flights."""


def features(motion: MotionOfPoses, t: Array, low: Array, high: Array) -> Array:
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
    spacing = np.maximum((high - low)[:2] / (_GRID_SPOTS - 1), 0.1)
    grid = [low[i] + spacing[i] * np.arange(_GRID_SPOTS) for i in (0, 1)]
    near = [np.exp(-0.5 * ((state[:, i, None] - grid[i]) / spacing[i]) ** 2) for i in (0, 1)]
    both = near[0][:, :, None] * near[1][:, None, :]
    return np.asarray(both.reshape(both.shape[0], -1))


def cross_validated_r2(problem: FlightProblem, fit: Fit) -> float:
    """Return the share (0 to 1) of the forces' remainder of a fit that other flights predict."""
    xs, ys = [], []
    motions = [linear.motion for linear in tangent_of(fit).linears]
    places = np.vstack([motion.state[:, :3] for motion in motions])
    low, high = places.min(axis=0), places.max(axis=0)
    for f, (track, motion) in enumerate(zip(problem.tracks, motions, strict=True)):
        group, forces = problem.rows_of(f, "force")
        smooth = track.kernel(group).smooth
        step = max(1, round(_BLOCK_S * problem.per_second(group)))
        # At rest a force against the motion has the direction of the pose's noise.
        moving = block_means(smooth @ motion.state[:, 3:6], step)
        fast = np.linalg.norm(moving, axis=1) > _MIN_SPEED_M_S
        used = fast if np.count_nonzero(fast) > _MIN_BLOCKS else np.ones(fast.size, np.bool_)
        xs.append(block_means(smooth @ features(motion, track.t, low, high), step)[used])
        ys.append(block_means(problem.residual(fit, f)[group][:, forces], step)[used])
    if len(xs) == 1:
        xs = np.array_split(xs[0], _FOLDS)
        ys = np.array_split(ys[0], _FOLDS)
    scale = np.maximum(np.vstack(xs).std(axis=0), 1e-9)
    xs = [x / scale for x in xs]
    # With and without the spots: a force at large needs none, and they dilute what it shows.
    return max(_held_out_r2([x[:, :last] for x in xs], ys) for last in (-(_GRID_SPOTS**2), None))


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


_STANDARD_ERRORS = 2.0
"""Standard errors of the logarithm of a variance that are subtracted from an excess."""


@dataclass(frozen=True)
class ResidualExcess:
    """One channel's remainder at its worst time scale."""

    channel: str
    unit: str
    scale_s: float
    measured: float
    """Root mean square at that scale."""
    expected: float
    excess: float
    """Logarithm of the ratio of variances, less what sampling may give; above 0: too much."""

    @property
    def beyond(self) -> float:
        """Variance over the expected one, as a share of that."""
        return max((self.measured / self.expected) ** 2 - 1.0, 0.0)

    @property
    def of_forces(self) -> bool:
        """Whether the channel is a force per mass."""
        return channel_group(self.channel) == "force"


@dataclass(frozen=True)
class ScaleVariances:
    """Variances by time scale of every channel, all flights together."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    variances: Array
    """(scales, channels)"""
    counts: Array
    """(scales, channels)"""


def residual_variances(
    problem: FlightProblem, fit: Fit, flights: Sequence[int] | None = None
) -> ScaleVariances:
    """Return the residual variances of a fit, tolerances used, of all flights or of some."""
    chosen = range(len(problem.tracks)) if flights is None else flights
    return _powers(problem, {f: problem.residual(fit, f) for f in chosen})


def noise_variances(problem: FlightProblem, theta: Array) -> ScaleVariances:
    """Return the variances that noise alone would leave, by one draw a flight."""
    drawn = map_flights(
        lambda track: simulated_noise(track, problem.nominal, theta, 1), problem.tracks
    )
    return _powers(problem, dict(enumerate(drawn)))


def with_healthy(expected: ScaleVariances, healthy: HealthyFlights | None) -> ScaleVariances:
    """Return the variances that noise leaves, or what healthy flights left where that is more."""
    if healthy is None:
        return expected
    variances = expected.variances.copy()
    for j, name in enumerate(expected.names):
        left = healthy.residuals.get(name, ())
        if len(left) == len(variances):
            variances[:, j] = np.maximum(variances[:, j], left)
    return replace(expected, variances=variances)


def _powers(problem: FlightProblem, rows: Mapping[int, dict[str, Array]]) -> ScaleVariances:
    """Return the variances of flights, weighed by their counts.

    `rows`: number of the flight -> group -> residual.
    """
    by_channel: dict[str, list[tuple[Array, Array]]] = {}
    units: dict[str, str] = {}
    for f, groups in rows.items():
        for group, residual in groups.items():
            variances, counts = block_variances(residual, 1.0 / problem.per_second(group))
            for j, c in enumerate(problem.channels[f][group]):
                by_channel.setdefault(c.name, []).append((variances[:, j], counts))
                units[c.name] = c.unit
    means, numbers = [], []
    for parts in by_channel.values():
        variances, counts = (np.array(part) for part in zip(*parts, strict=True))
        numbers.append(counts.sum(axis=0))
        total = np.where(counts > 0, np.nan_to_num(variances) * counts, 0.0).sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            means.append(total / numbers[-1])
    return ScaleVariances(
        tuple(by_channel), tuple(units.values()), np.column_stack(means), np.column_stack(numbers)
    )


def residual_excesses(measured: ScaleVariances, expected: ScaleVariances) -> list[ResidualExcess]:
    """Return every channel's remainder, the largest excess first."""
    result = []
    for j, name in enumerate(measured.names):
        floor = floors_of(name)[1] ** 2
        ratio = np.log(
            np.maximum(measured.variances[:, j], 1e-30) / (expected.variances[:, j] + floor)
        )
        error = np.sqrt(4.0 / np.maximum(measured.counts[:, j], 1.0))
        excess = ratio - _STANDARD_ERRORS * error
        excess[~np.isfinite(excess)] = -np.inf
        worst = int(np.argmax(excess))
        size = float(np.sqrt(max(measured.variances[worst, j], 0.0)))
        usual = float(np.sqrt(expected.variances[worst, j] + floor))
        result.append(
            ResidualExcess(
                name, measured.units[j], SCALES_S[worst], size, usual, float(excess[worst])
            )
        )
    return sorted(result, key=lambda each: -each.excess)


_GUST_TIMES_S = np.array([0.15, 0.3, 0.5, 0.8, 1.2, 2.0, 3.5, 7.0])
_MAX_GUST_TIME_S = 3.0
"""s: a force that holds for longer while the vehicle moves on is one of place, not of air."""
_GUST_LOG_TIME_SD = 0.3
"""Healthy scatter of the logarithm of the gusts' time."""
_GUST_DEVIATIONS_M_S = np.geomspace(0.05, 4.0, 120)
"""m/s"""
_MODEL_LOG_SD = 0.1
"""Healthy scatter of the logarithm of a power beyond sampling."""


@dataclass(frozen=True)
class GustFit:
    """Gusts fitted to the powers of the forces."""

    deviation: float
    time: float
    deviation_error: float
    time_error: float
    evidence: float
    """Log Bayes factor against the nominal model's own gusts."""
    theta: Array
    """The theta that was given, with these gusts."""
    at_edge: bool
    """Time or deviation are not those of gusts: another force was fitted."""
    stronger: bool
    """Gusts are stronger than in the nominal model; weaker ones need no cause."""


def fit_gusts(problem: FlightProblem, fit: Fit, measured: ScaleVariances) -> GustFit:
    """Fit deviation and time of the gusts to the residual forces of a fit, `measured`."""
    places = layout()["gusts"]
    forces = [j for j, n in enumerate(measured.names) if channel_group(n) == "force"]
    values = measured.variances[:, forces]
    error = np.sqrt(4.0 / np.maximum(measured.counts[:, forces], 1.0) + _MODEL_LOG_SD**2)
    usable = np.isfinite(values)

    def cost(model: Array) -> float:
        # Powers scatter as their number of blocks says; a logarithm makes that even.
        miss = (np.log(np.maximum(values, 1e-12)) - np.log(model + 1e-6)) / error
        return 0.5 * float(np.sum(miss[usable] ** 2))

    theta_without_gusts = fit.theta.copy()
    theta_without_gusts[places["deviation"]] = 0.0
    quiet = noise_variances(problem, theta_without_gusts)
    noise_only = quiet.variances[:, forces]
    # The residual of healthy flights says nothing about the air.
    usual = with_healthy(quiet, problem.nominal.healthy).variances[:, forces]
    costs, tried = [], []
    for time in _GUST_TIMES_S:
        theta_with_gusts = theta_without_gusts.copy()
        theta_with_gusts[places["deviation"]] = 1.0
        theta_with_gusts[places["time"]] = time
        # Force is linear in small gusts: powers add, and grow with the square of the deviation.
        unit = np.maximum(
            noise_variances(problem, theta_with_gusts).variances[:, forces] - noise_only, 0.0
        )
        for deviation in _GUST_DEVIATIONS_M_S:
            costs.append(cost(usual + deviation**2 * unit))
            tried.append((deviation, time))
    grid = np.array(tried)
    likelihood = np.exp(np.min(costs) - np.array(costs))
    weights = likelihood / likelihood.sum()
    points = np.log(grid)
    mean = weights @ points
    spread = np.sqrt(np.maximum(weights @ (points - mean) ** 2, 1e-6))
    deviation, time = (float(v) for v in np.exp(mean))
    theta = fit.theta.copy()
    theta[places["deviation"]], theta[places["time"]] = deviation, time
    deviation_parameter = next(p for p in PARAMETERS if p.index == places["deviation"])
    off = (grid[:, 0] - problem.theta[deviation_parameter.index]) / deviation_parameter.tolerance
    slow = np.log(grid[:, 1] / problem.theta[places["time"]]) / _GUST_LOG_TIME_SD
    healthy = np.exp(-0.5 * (off**2 + slow**2)) * grid[:, 0]
    healthy /= healthy.sum()
    evidence = math.log(max(float(likelihood.mean()), 1e-300))
    evidence -= math.log(max(float(likelihood @ healthy), 1e-300))
    return GustFit(
        deviation, time, deviation * float(spread[0]), time * float(spread[1]), evidence, theta,
        not _GUST_TIMES_S[0] * 1.2 < time < _MAX_GUST_TIME_S
        or deviation > _GUST_DEVIATIONS_M_S[-1] / 1.2,
        deviation > float(problem.theta[deviation_parameter.index]),
    )  # fmt: skip

"""Wind that swings: a sinusoidal force in map, of one frequency in all flights.

Each flight has its own phase, so flights can't share the swing as a parameter: it is fitted to the
residual forces of each flight, and is then simulated along that flight. A line that stands out of
its neighbours in the spectrum is a swing; gusts have power at all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from tombo_diagnosis.engine.cause_estimates import ParameterEstimate, as_tuples, fitted_parameter
from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.problem import FlightProblem, tangent_of
from tombo_diagnosis.flight.fit.track import WIND, Swing, Track
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import layout
from tombo_logs.checks.spans import block_means

_BLOCK_S = 0.24
"""Means over such blocks are fitted."""
_BLOCKS_PER_SAMPLE = 5.0
"""Blocks that count as one sample."""
_MIN_PERIODS, _MAX_FREQUENCY_HZ = 3.0, 1.5
"""Fewest periods in the shortest flight, and the highest frequency."""
_FREQUENCY_STEP, _NEIGHBOURS_FROM, _NEIGHBOURS_TO = 0.2, 1.5, 8.0
"""Over the time of the shortest flight: step of the frequencies that are tried, and from where to
where the neighbours of a line are."""
_MIN_LINE_RATIO, _MIN_LINE_SHARE = 10.0, 0.5
"""Least power of a line over its neighbours', and least share of the forces' residual."""
_MAX_ACROSS_SHARE = 0.5
"""Largest part across its direction over that along it: wind does not go round."""
_MIN_AIR_OVER_OWN = 1.0
"""Least swing of the air over the vehicle's own velocity at its frequency."""


@dataclass(frozen=True)
class _ForceSamples:
    """A flight's residual forces, and their slopes over wind, as block means."""

    t: Array
    """(B,) since the first tick [s]."""
    force: Array
    """(B, k)"""
    slopes: tuple[Array, Array]
    """(B, k) each: per m/s of wind along map x, y."""
    velocity: Array
    """(B, 2) of the vehicle along map x, y [m/s]."""

    def air(self, frequency: float) -> tuple[Array, float, Array]:
        """Return the air's swing, its reduction of the squares, and a covariance over noise.

        The swing: (2, 2) along map x, y by sine and cosine [m/s].
        """
        turn = 2.0 * np.pi * frequency * self.t
        waves = np.column_stack([np.sin(turn), np.cos(turn)])
        each = [s[:, :, None] * waves[:, None, :] for s in self.slopes]
        design = np.concatenate(each, axis=2).reshape(-1, 4)
        normal, vector = design.T @ design, design.T @ self.force.ravel()
        inverse = np.linalg.pinv(normal)
        values = inverse @ vector
        return values.reshape(2, 2), float(values @ vector), inverse

    def vehicle_velocity(self, frequency: float) -> float:
        """Return the amplitude of the vehicle's own velocity at a frequency [m/s]."""
        wave = np.exp(2j * np.pi * frequency * self.t) * (2.0 / self.t.size)
        return float(np.linalg.norm(wave @ (self.velocity - self.velocity.mean(axis=0))))


def with_swing(problem: FlightProblem, fit: Fit) -> list[Track] | None:
    """Return the flights with the swing of the air that a fit leaves of each; None: no swing."""
    pushes: dict[int, _ForceSamples] = {}
    for f, track in enumerate(problem.tracks):
        push = _force_samples(problem, fit, f)
        if push is None:
            return None
        known = pushes.get(id(track.log))
        pushes[id(track.log)] = push if known is None else _joined(known, push)
    frequency = _line_frequency(list(pushes.values()))
    if frequency is None:
        return None
    swings = {key: _swing(push, frequency) for key, push in pushes.items()}
    found = [swings[id(track.log)] for track in problem.tracks]
    if any(swing is None for swing in found):
        return None
    return [replace(t, swing=s) for t, s in zip(problem.tracks, found, strict=True)]


def _force_samples(problem: FlightProblem, fit: Fit, flight: int) -> _ForceSamples | None:
    track, linear = problem.tracks[flight], tangent_of(fit).linears[flight]
    places = [layout()[WIND][axis] for axis in ("east", "north")]
    group, forces = problem.rows_of(flight, "force")
    if not all(i in linear.slopes for i in places):
        return None  # without drag the air does nothing
    length = max(1, round(_BLOCK_S * problem.per_second(group)))
    rows = problem.residual(fit, flight)[group][:, forces]
    columns = [linear.slopes[i][group][:, forces] for i in places]
    pace = track.kernel(group).smooth @ linear.motion.state[:, 3:5]
    times = (track.times(group) - track.t[0])[:, None]
    t, force, east, north, velocity = (
        block_means(each, length) for each in (times, rows, *columns, pace)
    )
    return _ForceSamples(t[:, 0], force, (east, north), velocity)


def _joined(a: _ForceSamples, b: _ForceSamples) -> _ForceSamples:
    """Return two parts of a flight as one."""
    (ax, ay), (bx, by) = a.slopes, b.slopes
    pairs = ((a.t, b.t), (a.force, b.force), (ax, bx), (ay, by), (a.velocity, b.velocity))
    t, force, east, north, velocity = (np.concatenate(pair) for pair in pairs)
    return _ForceSamples(t, force, (east, north), velocity)


def _line_frequency(pushes: Sequence[_ForceSamples]) -> float | None:
    """Return the frequency [Hz] of a line in the spectrum of all flights; None: there is none."""
    length = min(float(p.t[-1] - p.t[0]) for p in pushes)
    tried = np.arange(1.0, _MAX_FREQUENCY_HZ * length, _FREQUENCY_STEP) / length
    if tried.size < _NEIGHBOURS_TO / _FREQUENCY_STEP:
        return None

    def power(frequency: float) -> float:
        return sum(p.air(frequency)[1] for p in pushes)

    powers = np.array([power(f) for f in tried])
    k = int(np.argmax(np.where(tried * length >= _MIN_PERIODS, powers, 0.0)))
    apart = (tried - tried[k]) * length
    sides = [
        (apart > -_NEIGHBOURS_TO) & (apart < -_NEIGHBOURS_FROM),
        (apart > _NEIGHBOURS_FROM) & (apart < _NEIGHBOURS_TO),
    ]
    beside = max(float(powers[side].mean()) for side in sides if side.any())
    total = sum(float(np.sum(p.force**2)) for p in pushes)
    if powers[k] < max(_MIN_LINE_RATIO * beside, _MIN_LINE_SHARE * total):
        return None
    around = (tried[k] - 0.5 / length, tried[k] + 0.5 / length)
    return float(minimize_scalar(lambda f: -power(f), bounds=around, method="bounded").x)


def _swing(push: _ForceSamples, frequency: float) -> Swing | None:
    """Return a flight's swing; None: it goes round, or is of the vehicle's own course."""
    air, taken, inverse = push.air(frequency)
    ways, sizes, waves = np.linalg.svd(air)
    size = float(sizes[0])
    if sizes[1] > _MAX_ACROSS_SHARE * size or size < _MIN_AIR_OVER_OWN * push.vehicle_velocity(
        frequency
    ):
        return None
    left = (float(np.sum(push.force**2)) - taken) / push.force.size
    deviation = math.sqrt(max(left * _BLOCKS_PER_SAMPLE * float(np.trace(inverse)) / 4.0, 1e-12))
    samples = push.t.size / _BLOCKS_PER_SAMPLE
    spread = math.sqrt(6.0 / samples) * deviation * math.sqrt(samples / 2.0) / size
    length = float(push.t[-1] - push.t[0])
    east, north = (float(x) for x in size * ways[:, 0])
    phase = math.atan2(float(waves[0, 1]), float(waves[0, 0]))
    return Swing(east, north, frequency, phase, deviation, spread / (math.pi * length))


def along(tracks: Sequence[Track], east: float, north: float) -> bool:
    """Return whether the flights' swings are along a mean wind [m/s], within 45 degrees."""
    size = math.hypot(east, north)
    return all(
        abs(s.east * east + s.north * north) > math.sqrt(0.5) * size * math.hypot(s.east, s.north)
        for s in (track.swing for track in tracks)
        if s is not None
    )


def swing_estimate(problem: FlightProblem, east: float, north: float) -> ParameterEstimate:
    """Return the swing's parameters over all flights, counted along a mean wind [m/s].

    The phase is each flight's own: it is given of one flight only.
    """
    swings = list({id(t.log): t.swing for t in problem.tracks if t.swing is not None}.values())
    if not swings:
        return (), ()
    places = layout()[WIND]
    signs = [1.0 if s.east * east + s.north * north >= 0.0 else -1.0 for s in swings]
    count = len(swings)
    rows: dict[str, tuple[float, float]] = {}
    for axis in ("east", "north"):
        values = np.array([g * getattr(s, axis) for g, s in zip(signs, swings, strict=True)])
        spread = float(values.std(ddof=1)) if count > 1 else 0.0
        error = math.hypot(spread, max(s.deviation for s in swings)) / math.sqrt(count)
        rows[f"swing_{axis}"] = float(values.mean()), error
    error = max(s.frequency_deviation for s in swings) / math.sqrt(count)
    rows["frequency"] = swings[0].frequency, error
    if count == 1:
        phase = math.remainder(swings[0].phase + (0.0 if signs[0] > 0.0 else math.pi), 2 * math.pi)
        rows["phase"] = phase, swings[0].deviation / math.hypot(swings[0].east, swings[0].north)
    parameters = problem.nominal.parameters
    fitted = [
        fitted_parameter(parameters[places[name]], parameters[places[name]].null, *row)
        for name, row in rows.items()
    ]
    return tuple(fitted), as_tuples(np.diag([error**2 for _, error in rows.values()]))

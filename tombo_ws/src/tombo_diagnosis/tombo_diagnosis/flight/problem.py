"""All flights of a diagnosis as one regression: residuals, slopes, noise, and what fits them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.flight.evidence import NormalEquations, Posterior, solve
from tombo_diagnosis.flight.noise_variance import floor_of, long_run_variance
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.flight.parameters import WIDE, Parameter
from tombo_diagnosis.flight.prediction import channels_of
from tombo_diagnosis.flight.sensitivity import Linearization, linearize, map_flights
from tombo_diagnosis.flight.track import FAST_SPACING, SLOW_SPACING, Track

Array = NDArray[np.float64]

_STEPS = 6
"""Gauss-Newton steps of a refinement, at most."""
_VISIBLE = 0.25
"""Share of a channel's noise that an effect must have at the size that matters."""
_VISIBILITY_WINDOW_S = 2.0
"""s: over which that is taken, where the effect is largest."""
_PINNED = 1e-3
_BEYOND = 0.3
"""Tolerances by which a parameter may pass a bound before it is pinned there."""
TIGHT = 0.2
"""Factor on the tolerances in a first step."""
_MAX_TOLERANCE_SIGMAS = 3.0
"""Tolerances are exceeded by healthy vehicles up to this many deviations."""
_CLOSE = 0.05
"""A refinement ends when no free parameter moves by more than this share of its tolerance."""


Parts = dict[str, tuple[Array, Array, Array]]
"""group -> normal matrices (channels, K, K), vectors (channels, K), squares (channels)."""


@dataclass(frozen=True)
class Columns:
    """What the unknowns are: parameters of theta, then the vehicle's draws."""

    indices: tuple[int, ...]
    """Places in theta of the parameters that these flights can show."""
    draws: int
    """Draws of one vehicle that do something."""
    vehicles: int
    """Sets of draws: one for all flights, or one a flight."""
    draw_width: float
    """Standard deviation of a draw's unknown in the nominal model."""
    parameters: tuple[Parameter, ...]
    """All of theta."""
    absorbed: frozenset[int] = frozenset()
    """Places in theta of what the nominal model's own fit has taken up: always free."""

    unobservable: frozenset[int] = frozenset()
    """Places in theta of what, at the size that matters, is far below these flights' noise."""

    @cached_property
    def identifiable(self) -> tuple[int, ...]:
        """Places in theta of what can be a cause."""
        return tuple(
            i for i in self.indices if i not in self.absorbed and i not in self.unobservable
        )

    @property
    def count(self) -> int:
        """All unknowns."""
        return len(self.indices) + self.draws * self.vehicles

    def deviations(
        self,
        free: Sequence[int] = (),
        width: float = WIDE,
        draw_width: float | None = None,
        tight: float = 1.0,
        pinned: Sequence[int] = (),
    ) -> Array:
        """Return (count) prior standard deviations.

        Args:
            free: places in theta of what is wide.
            width: how wide, in sizes that matter.
            draw_width: of the draws; None: as in the nominal model.
            tight: factor on the tolerances of everything else.
            pinned: columns that stay where they are: at a bound of their parameter.
        """
        own = [
            width * self.parameters[i].scale
            if i in free or i in self.absorbed
            else tight * self.parameters[i].tolerance
            for i in self.indices
        ]
        drawn = self.draw_width if draw_width is None else draw_width
        deviations = np.array(own + [drawn] * (self.draws * self.vehicles))
        deviations[list(pinned)] *= _PINNED
        return deviations

    def places(self, indices: Sequence[int]) -> list[int]:
        """Return the columns of parameters that can be seen."""
        return [self.indices.index(i) for i in indices if i in self.indices]

    def first_draw(self, flight: int) -> int:
        """Return the column of a flight's first draw."""
        vehicle = flight if self.vehicles > 1 else 0
        return len(self.indices) + self.draws * vehicle


@dataclass(frozen=True)
class Fit:
    """A set of freed parameters, fitted; all else within its tolerance."""

    free: tuple[int, ...]
    """Places in theta."""
    draw_width: float
    """Standard deviation of the draws' unknowns."""
    theta: Array
    """All parameters: the free ones fitted, the others where their tolerance lets the data have
    them."""
    prior_mean: Array
    """(K,) means of the prior, about theta."""
    solution: Posterior
    """About `theta`, so that its mean is what is left to do: nearly nothing for free ones."""
    linears: tuple[Linearization, ...]
    """About `theta`."""
    normals: tuple[NormalEquations, ...]
    """A flight each, about `theta`."""
    parts: tuple[Parts, ...]
    """The same by channel, not weighed."""
    pinned: tuple[int, ...] = ()
    """Columns that the data would carry beyond a bound; they stay at it."""

    @property
    def evidence(self) -> float:
        """Logarithm of the probability of the data."""
        return self.solution.evidence


class Problem:
    """The regression about the nominal model. All fits are made from here."""

    def __init__(self, tracks: Sequence[Track], nominal: NominalModel) -> None:
        self.tracks = list(tracks)
        self.nominal = nominal
        self.theta = nominal.theta
        self.channels = [channels_of(track, nominal) for track in self.tracks]
        self.linears = map_flights(lambda t: linearize(t, nominal, self.theta), self.tracks)
        seen = sorted({i for linear in self.linears for i in linear.slopes})
        draws = max(len(linear.draws) for linear in self.linears)
        absorbed = frozenset(p.index for p in nominal.parameters if p.label in nominal.fitted)
        width = self.linears[0].draw_width
        own = Columns(tuple(seen), draws, len(self.tracks), width, nominal.parameters, absorbed)
        self.columns = own
        self._parts: list[Parts] = []
        self.variances: list[dict[str, Array]] = []
        """Noise of each flight's channels by group, correlation included."""
        self._prepare()
        if draws and len(self.tracks) > 1:
            every = solve(self.normal(), own.deviations(seen)).evidence
            kept = self._parts
            self.columns = replace(own, vehicles=1)
            # With the same noise as before: what does not fit would else pass for noise.
            self._parts = [self._by_channel(linear, f) for f, linear in enumerate(self.linears)]
            if solve(self.normal(), self.columns.deviations(seen)).evidence < every:
                self.columns = own
                self._parts = kept
            else:
                self._prepare()
        noisy = frozenset.intersection(*(linear.noisy for linear in self.linears))
        self.columns = replace(self.columns, unobservable=self._find_unobservable() | noisy)
        self.normals = [self._weigh(parts, f) for f, parts in enumerate(self._parts)]
        prior_mean = np.zeros(self.columns.count)
        solution, pinned = self._bounded(self.normals, (), None, self.theta, prior_mean)
        self.null_hypothesis = Fit(
            (), self.columns.draw_width, self.theta, prior_mean,
            solution,
            tuple(self.linears), tuple(self.normals), tuple(self._parts), pinned,
        )  # fmt: skip
        self.null_hypothesis = self.refine((), self.null_hypothesis, slopes=False)
        """The nominal model, everything within its tolerance."""

    def _prepare(self) -> None:
        self._parts = [self._by_channel(linear, f) for f, linear in enumerate(self.linears)]
        self.variances = [
            {g: np.maximum(v.var(axis=0), 1e-12) * 20.0 for g, v in linear.residual.items()}
            for linear in self.linears
        ]
        for _ in range(2):
            every = solve(self.normal(), self.columns.deviations(self.columns.indices))
            self.variances = self._variances(every.mean)

    def _find_unobservable(self) -> frozenset[int]:
        """Return what can't be seen: in every channel, even at its loudest, a share of the noise.

        Averaged over minutes it would still stand out of white noise. But in a hover what little
        moves is noise itself, that went through the estimator into the commands and came back.
        What shows now and then only, as the ground does in a landing, counts by these moments.
        """
        every = solve(self.normal(), self.columns.deviations(self.columns.indices)).mean
        noise: dict[tuple[str, str], list[float]] = {}
        shown: dict[int, dict[tuple[str, str], list[float]]] = {}
        for f, linear in enumerate(self.linears):
            for group, rows in linear.residual.items():
                rest = rows - self._explained(linear, group, f, every)
                own = [c.name for c in self.channels[f] if c.group == group]
                for name, value in zip(own, np.mean(rest**2, axis=0), strict=True):
                    noise.setdefault((group, name), []).append(float(value))
                for index, change in linear.slopes.items():
                    sizes = _max_block_mean(
                        change[group] ** 2, round(_VISIBILITY_WINDOW_S * self.per_second(group))
                    )
                    table = shown.setdefault(index, {})
                    for name, value in zip(own, sizes, strict=True):
                        table.setdefault((group, name), []).append(float(value))
        unobservable = set()
        for index, table in shown.items():
            scale = self.columns.parameters[index].scale
            best = max(
                scale**2 * float(np.mean(values)) / max(float(np.mean(noise[place])), 1e-18)
                for place, values in table.items()
            )
            if best < _VISIBLE**2:
                unobservable.add(index)
        return frozenset(unobservable)

    def normal(self) -> NormalEquations:
        """Return the equations of all flights about the nominal model."""
        return sum_of([self._weigh(parts, f) for f, parts in enumerate(self._parts)])

    def _design(self, linear: Linearization, group: str, flight: int) -> Array:
        """Return (channels, K, rows): slopes of a group's channels with every unknown."""
        residual = linear.residual[group]
        full = np.zeros((residual.shape[1], self.columns.count, residual.shape[0]))
        for k, index in enumerate(self.columns.indices):
            if index in linear.slopes:
                full[:, k] = linear.slopes[index][group].T
        first = self.columns.first_draw(flight)
        for j, change in enumerate(linear.draws):
            full[:, first + j] = change[group].T
        return full

    def _explained(self, linear: Linearization, group: str, flight: int, unknowns: Array) -> Array:
        """Return (rows, channels): what unknowns (K,) change in a group's channels."""
        total = np.zeros_like(linear.residual[group])
        for k, index in enumerate(self.columns.indices):
            if unknowns[k] and index in linear.slopes:
                total += unknowns[k] * linear.slopes[index][group]
        first = self.columns.first_draw(flight)
        for j, change in enumerate(linear.draws):
            total += unknowns[first + j] * change[group]
        return total

    def residual(self, fit: Fit, flight: int, unknowns: Array | None = None) -> dict[str, Array]:
        """Return what a fit leaves of a flight's channels, group -> (rows, channels).

        Args:
            fit: the fit.
            flight: number of the flight.
            unknowns: (K,) about the fit's theta; None: its solution, tolerances included.
        """
        mean = self._clip_to_tolerances(fit) if unknowns is None else unknowns
        linear = fit.linears[flight]
        return {
            group: rows - self._explained(linear, group, flight, mean)
            for group, rows in linear.residual.items()
        }

    def _bounded(
        self,
        normals: Sequence[NormalEquations],
        free: Sequence[int],
        draw_width: float | None,
        theta: Array,
        prior_mean: Array,
    ) -> tuple[Posterior, tuple[int, ...]]:
        """Solve, and pin what the data would carry beyond its bounds: no delay is negative.

        Of what is free, only what would pass the bound at which it does nothing: a propeller that
        is stronger than new, made up for by scatter that is none, turns the vehicle at will.
        """
        columns = self.columns
        normal = sum_of(normals)
        pinned: list[int] = []
        while True:
            deviations = columns.deviations(free, draw_width=draw_width, pinned=pinned)
            solution = solve(normal, deviations, prior_mean)
            over = []
            for place, index in enumerate(columns.indices):
                p = columns.parameters[index]
                value = theta[index] + solution.mean[place]
                slack = _BEYOND * p.tolerance
                outside = value < p.low - slack or value > p.high + slack
                bound = p.low if value < p.low else p.high
                held = index not in free or bound == self.theta[index]
                if outside and held and place not in pinned:
                    over.append(place)
            if not over:
                return solution, tuple(pinned)
            pinned += over

    def _clip_to_tolerances(self, fit: Fit) -> Array:
        """Return a fit's unknowns, what is not free held to a few tolerances: more is a cause."""
        limits = _MAX_TOLERANCE_SIGMAS * self.columns.deviations(
            fit.free, draw_width=fit.draw_width
        )
        return np.clip(fit.solution.mean, fit.prior_mean - limits, fit.prior_mean + limits)

    def refine(
        self,
        free: Sequence[int],
        start: Fit | None = None,
        draw_width: float | None = None,
        slopes: bool = True,
    ) -> Fit:
        """Fit parameters with the model itself, not only its tangent: Gauss-Newton.

        Args:
            free: places in theta.
            start: fit to begin from; None: the nominal model.
            draw_width: standard deviation of the draws; None: that of `start`.
            slopes: False: those of `start` will do.
        """
        start = start or self.null_hypothesis
        width = start.draw_width if draw_width is None else draw_width
        columns = self.columns
        theta, linears, normals = start.theta, start.linears, start.normals
        parts = start.parts
        prior_mean = start.prior_mean.copy()
        # The first step leaves little to tolerances: where an effect is large, the tangent's own
        # error would be paid by whatever tolerance happens to look like it.
        held = columns.deviations(free, draw_width=width, tight=TIGHT if slopes else 1.0)
        solution = solve(sum_of(normals), held, prior_mean)
        pinned: tuple[int, ...] = ()
        for step in range(_STEPS):
            moved = theta.copy()
            for place, index in enumerate(columns.indices):
                p = columns.parameters[index]
                moved[index] = np.clip(theta[index] + solution.mean[place], p.low, p.high)
            # Every parameter moves: where data are this sharp, a tolerance is no tangent either.
            change = max(
                abs(moved[i] - theta[i]) / columns.parameters[i].tolerance for i in columns.indices
            )
            if change < _CLOSE:
                break
            theta = moved
            # Slopes change little on the way: they are taken anew once, residuals every time.
            anew = free if slopes and step == 0 else ()
            linears, parts = self._about(theta, anew, linears, parts, free)
            normals = self._weighed(parts)
            for place, index in enumerate(columns.indices):
                prior_mean[place] = self.theta[index] - theta[index]
            solution, pinned = self._bounded(normals, free, width, theta, prior_mean)
            if step and change < 0.3:
                break
        if theta is start.theta:
            solution, pinned = self._bounded(normals, free, width, theta, prior_mean)
        return Fit(
            tuple(free), width, theta, prior_mean, solution, linears, normals, parts, pinned
        )

    def relinearized(self, fit: Fit) -> Fit:
        """Return a fit with the slopes of everything taken where it is, not in the nominal model.

        Wind times drag is not wind plus drag: what tolerances may do depends on what was named.
        """
        linears, parts = self._about(
            fit.theta, self.columns.indices, fit.linears, fit.parts, self.columns.indices
        )
        again = replace(fit, linears=linears, parts=parts, normals=self._weighed(parts))
        return self.refine(fit.free, again, fit.draw_width, slopes=False)

    def _weighed(self, parts: Sequence[Parts]) -> tuple[NormalEquations, ...]:
        return tuple(self._weigh(part, f) for f, part in enumerate(parts))

    def _about(
        self,
        theta: Array,
        anew: Sequence[int],
        before: Sequence[Linearization],
        parts: Sequence[Parts],
        free: Sequence[int],
    ) -> tuple[tuple[Linearization, ...], tuple[Parts, ...]]:
        """Return residuals at theta, slopes of the parameters `anew`, and their equations."""
        fresh = map_flights(
            lambda each: linearize(each[0], self.nominal, theta, tuple(anew), each[1]),
            list(zip(self.tracks, self.linears, strict=True)),
        )
        linears = tuple(
            replace(new, slopes={**old.slopes, **new.slopes}, draws=old.draws)
            for new, old in zip(fresh, before, strict=True)
        )
        places = self.columns.places(free)
        return linears, tuple(
            self._changed(linear, f, part, places if anew else [])
            for f, (linear, part) in enumerate(zip(linears, parts, strict=True))
        )

    def _changed(
        self, linear: Linearization, flight: int, before: Parts, places: Sequence[int]
    ) -> Parts:
        """Return the normal equations where the residuals and the slopes at `places` are new."""
        parts = {}
        for group, residual in linear.residual.items():
            turned = self._design(linear, group, flight)
            matrices = before[group][0]
            if len(places):
                matrices = matrices.copy()
                cross = turned @ np.transpose(turned[:, places], (0, 2, 1))
                matrices[:, :, places] = cross
                matrices[:, places, :] = np.transpose(cross, (0, 2, 1))
            vectors = (turned @ residual.T[:, :, None])[:, :, 0]
            parts[group] = (matrices, vectors, np.sum(residual**2, axis=0))
        return parts

    def _by_channel(self, linear: Linearization, flight: int) -> Parts:
        """Return group -> normal matrices, vectors and squares of its channels, not weighed."""
        parts = {}
        for group, residual in linear.residual.items():
            turned = self._design(linear, group, flight)
            vectors = (turned @ residual.T[:, :, None])[:, :, 0]
            matrices = turned @ np.transpose(turned, (0, 2, 1))
            parts[group] = (matrices, vectors, np.sum(residual**2, axis=0))
        return parts

    def _weigh(self, parts: Parts, flight: int) -> NormalEquations:
        matrix = np.zeros((self.columns.count, self.columns.count))
        vector = np.zeros(self.columns.count)
        square = 0.0
        for group, (matrices, vectors, squares) in parts.items():
            weights = 1.0 / self.variances[flight][group]
            matrix += np.tensordot(weights, matrices, 1)
            vector += weights @ vectors
            square += float(weights @ squares)
        return NormalEquations(matrix, vector, square)

    def _variances(self, unknowns: Array) -> list[dict[str, Array]]:
        """Return the noise of each flight's channels, from what the unknowns leave over."""
        residual: dict[tuple[str, str], list[Array]] = {}
        for f, linear in enumerate(self.linears):
            for group, rows in linear.residual.items():
                rest = rows - self._explained(linear, group, f, unknowns)
                own = [c for c in self.channels[f] if c.group == group]
                for j, c in enumerate(own):
                    residual.setdefault((group, c.name), []).append(rest[:, j])
        found = {
            (group, name): long_run_variance(rows, self.per_second(group), floor_of(name))
            for (group, name), rows in residual.items()
        }
        return [
            {
                group: np.array([found[group, c.name] for c in channels if c.group == group])
                for group in linear.residual
            }
            for linear, channels in zip(self.linears, self.channels, strict=True)
        ]

    def per_second(self, group: str) -> float:
        """Return how many rows a group has in a second."""
        if group == "fast":
            return 1.0 / FAST_SPACING
        if group == "slow":
            return 1.0 / SLOW_SPACING
        return 1.0 / float(np.median(np.diff(self.tracks[0].pose_t)))


def sum_of(normals: Sequence[NormalEquations]) -> NormalEquations:
    """Return the equations of all flights together."""
    total = normals[0]
    for other in normals[1:]:
        total = total + other
    return total


def _max_block_mean(squares: Array, rows: int) -> Array:
    """Return (channels): the largest mean of (rows, channels) over so many rows in a row."""
    whole = squares.shape[0] // rows * rows
    if not whole:
        rows = whole = squares.shape[0]
    blocks = squares[:whole].reshape(-1, rows, squares.shape[1])
    return np.asarray(blocks.mean(axis=1).max(axis=0))

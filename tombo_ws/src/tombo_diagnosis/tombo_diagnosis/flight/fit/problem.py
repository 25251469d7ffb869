"""All flights of a diagnosis as one regression: residuals, slopes, noise, fits."""

from __future__ import annotations

import math
import operator
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from tombo_diagnosis.engine.model import Setting
from tombo_diagnosis.engine.regression import (
    NOMINAL_WIDTHS,
    TIGHT,
    Fit,
    NormalEquations,
    Posterior,
    Unknowns,
    solve,
)
from tombo_diagnosis.engine.verdict import succession
from tombo_diagnosis.flight.fit.prediction import channel_group, channels_of
from tombo_diagnosis.flight.fit.sensitivity import Linearization, linearize, map_flights
from tombo_diagnosis.flight.fit.track import FAST_SPACING, SLOW_SPACING, Track
from tombo_diagnosis.flight.noise import floors_of, long_run_of_scales, long_run_variance
from tombo_diagnosis.flight.nominal import SCATTER, NominalModel
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY
from tombo_flight.vehicle_file import HealthyFlights
from tombo_logs.checks.spans import block_means

_STEPS = 6
"""Gauss-Newton steps of a refinement, at most."""
_VISIBLE = 0.25
"""Share of a channel's noise that an effect must have at the size that matters."""
_VISIBILITY_WINDOW_S = 2.0
"""s: over which that is taken, where the effect is largest."""
_BEYOND = 0.3
"""Tolerances by which a parameter may pass a bound before it is pinned there."""
_MAX_TOLERANCE_SIGMAS = 3.0
"""Tolerances are exceeded by healthy vehicles up to this many deviations."""
_CLOSE = 0.05
"""A refinement ends when no free parameter moves by more than this share of its tolerance."""

SETTING = Setting(
    max_fitted=4,  # a fit of flights takes some tenths of a second
    # Along a flight errors of the model add up: where much is at stake they outweigh noise.
    model_error_share=0.05,
    # Found on synthetic cases of other seeds: small causes hide in healthy flights' noise.
    calibration={"none": ((0.0, 0.0), (1.0, 0.85))},
    confounded_with={name: effect.confounded_with for name, effect in REGISTRY.items()},
)

CALIBRATED_MODEL_ERROR_SHARE = 0.3
"""`model_error_share` of a vehicle whose thrust was fitted to the same flights: its model is
rough, and even a large evidence does not distinguish causes where it rests on a few percent of
thrust."""
DISPLACEMENTS = frozenset({"imu_lever_arm", "mocap_marker_offset"})
"""Displaced IMU and displaced markers: only their distance shows where forces are unsure."""


def setting_of(nominal: NominalModel, flights: int) -> Setting:
    """Return the settings for a nominal model.

    Confidence stays below what flights allow: each healthy flight that was compared with the
    vehicle of the others is one trial, and a failure if a cause was named; of one that was fitted
    to the very flights each flight held out. A fault of one flight is present in all its parts:
    these are one trial. That a vehicle is as its healthy flights show it is as probable before the
    data as all effects of the registry together.
    """
    if nominal.healthy is not None:
        return replace(
            SETTING,
            max_confidence=healthy_confidence(nominal.healthy),
            log_prior_cost=math.log(sum(not effect.company for effect in REGISTRY.values())),
        )
    if not nominal.calibrated:
        return SETTING
    return replace(
        SETTING,
        model_error_share=CALIBRATED_MODEL_ERROR_SHARE,
        equivalent=(DISPLACEMENTS,),
        max_confidence=succession(flights, 0),
    )


def healthy_confidence(healthy: HealthyFlights) -> float:
    """Return the confidence that a vehicle allows which was fitted to healthy flights."""
    return succession(healthy.left_out, healthy.accused)


@dataclass(frozen=True)
class FlightTangent:
    """The equations of a fit, flight by flight."""

    linears: tuple[Linearization, ...]
    normals: tuple[NormalEquations, ...]


def tangent_of(fit: Fit) -> FlightTangent:
    """Return the equations of a fit, flight by flight."""
    assert isinstance(fit.tangent, FlightTangent)
    return fit.tangent


class FlightProblem:
    """The regression of flights about their nominal model: a `Model` of the engine."""

    def __init__(self, tracks: Sequence[Track], nominal: NominalModel) -> None:
        self.setting = setting_of(nominal, len({id(track.log) for track in tracks}))
        self.tracks = list(tracks)
        self.nominal = nominal
        self.theta = nominal.theta
        self.channels = [channels_of(track, nominal) for track in self.tracks]
        """Of each flight: group -> its channels, in the order of `residuals`."""
        self.linears = map_flights(lambda t: linearize(t, nominal, self.theta), self.tracks)
        seen = sorted({i for linear in self.linears for i in linear.slopes})
        self.drawn = sorted({i for linear in self.linears for i in linear.draws})
        """Draws of one vehicle that do something in the nominal model: they have columns. About
        other parameters others may do something, next to nothing, and are left out."""
        self.vehicles = len(self.tracks)
        """Sets of draws: one a flight, or one for all flights."""
        absorbed = frozenset(p.index for p in nominal.parameters if p.label in nominal.fitted)
        width = self.linears[0].draw_width
        each = (SCATTER,) * len(self.drawn)
        unknowns = Unknowns(
            nominal.parameters,
            tuple(seen),
            each * self.vehicles,
            width,
            nominal.tolerance_inflation,
            absorbed,
        )
        self.unknowns = unknowns
        self.variances: list[dict[str, Array]] = []
        """Noise of each flight's channels by group, correlation included."""
        self.normals: tuple[NormalEquations, ...] = ()
        """Of each flight, about the nominal model."""
        self._estimate_noise()
        if each and self.vehicles > 1:
            every = solve(self.normal(), unknowns.deviations(seen)).evidence
            normals = self.normals
            self.unknowns, self.vehicles = replace(unknowns, draws=each), 1
            # With the same noise as before: what does not fit would else pass for noise.
            self.normals = self._normals(self.linears)
            if solve(self.normal(), self.unknowns.deviations(seen)).evidence < every:
                self.unknowns, self.vehicles = unknowns, len(self.tracks)
                self.normals = normals
            else:
                self._estimate_noise()
        self.unknowns = replace(self.unknowns, unobservable=self._find_unobservable())
        tangent = FlightTangent(tuple(self.linears), self.normals)
        nominal_fit = self._solved(
            (), NOMINAL_WIDTHS, self.theta, np.zeros(self.unknowns.count), tangent
        )
        self.null_hypothesis = self.fit((), NOMINAL_WIDTHS, nominal_fit, slopes=False)
        """The nominal model, everything within its tolerance."""

    def refuse(self, effects: Collection[str]) -> None:
        """Let these effects be no causes from now on."""
        self.unknowns = replace(self.unknowns, refused=frozenset(effects))

    def noise_effects(self) -> Mapping[str, float]:
        """Return the scatter of the rotors, where they differ; others show in what is left.

        It shows in moments: thrust of all rotors together is fitted where these are not compared.
        """
        possible = self.unknowns.draws and SCATTER not in self.unknowns.refused
        return {SCATTER: 0.0} if possible and self.nominal.moments else {}

    def evidence_with(
        self, fit: Fit, prior_std_scale: Mapping[str, float], tight: float = 1.0
    ) -> float:
        """Return the log evidence of a fit with other widths of random effects, by its tangent."""
        deviations = self.unknowns.deviations(fit.free, prior_std_scale, tight, fit.pinned)
        return solve(fit.normal, deviations, fit.prior_mean, covariance=False).evidence

    def final(self, fit: Fit) -> Array:
        """Return the parameters that a fit came to."""
        return fit.theta

    def rows_of(self, flight: int, quantity: str) -> tuple[str, list[int]]:
        """Return the group of rows that shows a quantity of `channel_group`, and its channels.

        Empty, where a flight does not show it.
        """
        for group, channels in self.channels[flight].items():
            places = [k for k, c in enumerate(channels) if channel_group(c.name) == quantity]
            if places:
                return group, places
        return "", []

    def first_draw(self, flight: int) -> int:
        """Return the column of a flight's first draw."""
        vehicle = flight if self.vehicles > 1 else 0
        return len(self.unknowns.indices) + len(self.drawn) * vehicle

    def _estimate_noise(self) -> None:
        self.variances = [
            {g: np.maximum(v.var(axis=0), 1e-12) * 20.0 for g, v in linear.residual.items()}
            for linear in self.linears
        ]
        self.normals = self._normals(self.linears)
        for _ in range(2):
            every = solve(self.normal(), self.unknowns.deviations(self.unknowns.indices))
            self.variances = self._variances(every.mean)
            self.normals = self._normals(self.linears)

    def _find_unobservable(self) -> frozenset[int]:
        """Return what stays below a share of the noise even where its signal is largest.

        Averaged over minutes it would still stand out of white noise. But in a hover what little
        moves is noise itself, that went through the estimator into the commands and came back.
        What shows now and then only, as the ground does in a landing, counts by these moments.
        """
        every = solve(self.normal(), self.unknowns.deviations(self.unknowns.indices)).mean
        noise = {
            channel: max(float(np.mean([np.mean(rows**2) for rows in flights])), 1e-18)
            for channel, flights in self._rest(every).items()
        }
        unobservable = set()
        for index in self.unknowns.indices:
            shown: dict[tuple[str, str], list[float]] = {}
            for channels, linear in zip(self.channels, self.linears, strict=True):
                for group, change in linear.slopes.get(index, {}).items():
                    window = round(_VISIBILITY_WINDOW_S * self.per_second(group))
                    largest = block_means(change**2, min(window, len(change))).max(axis=0)
                    for c, square in zip(channels[group], largest, strict=True):
                        shown.setdefault((group, c.name), []).append(float(square))
            scale = self.unknowns.parameters[index].scale
            best = max(float(np.mean(v)) / noise[channel] for channel, v in shown.items())
            if scale**2 * best < _VISIBLE**2:
                unobservable.add(index)
        return frozenset(unobservable)

    def normal(self) -> NormalEquations:
        """Return the equations of all flights about the nominal model."""
        return sum_of(self.normals)

    def design(self, linear: Linearization, group: str, flight: int) -> Array:
        """Return (channels, K, rows): slopes of a group's channels with every unknown."""
        residual = linear.residual[group]
        full = np.zeros((residual.shape[1], self.unknowns.count, residual.shape[0]))
        for k, index in enumerate(self.unknowns.indices):
            if index in linear.slopes:
                full[:, k] = linear.slopes[index][group].T
        first = self.first_draw(flight)
        for j, draw in enumerate(self.drawn):
            if draw in linear.draws:
                full[:, first + j] = linear.draws[draw][group].T
        return full

    def _explained(self, linear: Linearization, group: str, flight: int, unknowns: Array) -> Array:
        """Return (rows, channels): what unknowns (K,) change in a group's channels."""
        return np.asarray(np.tensordot(unknowns, self.design(linear, group, flight), (0, 1)).T)

    def residual(self, fit: Fit, flight: int) -> dict[str, Array]:
        """Return the residual of a flight's channels by a fit, group -> (rows, channels)."""
        # Parameters that are not free stay within a few tolerances: more is a cause.
        deviations = self.unknowns.deviations(fit.free, fit.prior_std_scale)
        limits = _MAX_TOLERANCE_SIGMAS * deviations
        low, high = fit.prior_mean - limits, fit.prior_mean + limits
        unknowns = np.clip(fit.solution.mean, low, high)
        linear = tangent_of(fit).linears[flight]
        return {
            group: rows - self._explained(linear, group, flight, unknowns)
            for group, rows in linear.residual.items()
        }

    def solve_in_bounds(
        self,
        normal: NormalEquations,
        free: Sequence[int],
        prior_std_scale: Mapping[str, float],
        theta: Array,
        prior_mean: Array,
        *,
        slack: float = _BEYOND,
        pinned: Sequence[int] = (),
        pin_free: bool = True,
    ) -> tuple[Posterior, tuple[int, ...]]:
        """Return what equations about theta come to, and the columns that stay at a bound.

        A parameter that the data would move beyond its bound is pinned there: no delay is
        negative. A free parameter is pinned only at the bound where it has no effect, or not at
        all: a propeller that is stronger than new, with a scatter that makes up for it, turns the
        vehicle at will.

        Args:
            normal: the equations.
            free: places in theta.
            prior_std_scale: stochastic effect -> factor on its width.
            theta: all parameters.
            prior_mean: (K,) about theta.
            slack: tolerances by which a parameter may pass a bound.
            pinned: columns that are pinned anyway.
            pin_free: False: free parameters stay free.
        """
        unknowns, columns = self.unknowns, list(pinned)
        while True:
            deviations = unknowns.deviations(free, prior_std_scale, pinned=columns)
            solution = solve(normal, deviations, prior_mean)
            over = []
            for place, index in enumerate(unknowns.indices):
                p = unknowns.parameters[index]
                value = theta[index] + solution.mean[place]
                room = slack * p.resolution
                outside = value < p.low - room or value > p.high + room
                bound = p.low if value < p.low else p.high
                held = index not in free or (pin_free and bound == self.theta[index])
                if outside and held and place not in columns:
                    over.append(place)
            if not over:
                return solution, tuple(columns)
            columns += over

    def _solved(
        self,
        free: Sequence[int],
        prior_std_scale: Mapping[str, float],
        theta: Array,
        prior_mean: Array,
        tangent: FlightTangent,
    ) -> Fit:
        """Return the fit that the equations of a tangent about theta come to."""
        normal = sum_of(tangent.normals)
        solution, pinned = self.solve_in_bounds(normal, free, prior_std_scale, theta, prior_mean)
        return Fit(
            tuple(free), prior_std_scale, theta, prior_mean, solution, normal, solution.evidence,
            tangent, pinned,
        )  # fmt: skip

    def fit(
        self,
        free: Sequence[int],
        prior_std_scale: Mapping[str, float],
        start: Fit,
        slopes: bool = True,
    ) -> Fit:
        """Fit as `Model.fit` says, by Gauss-Newton.

        `slopes`: take those of the free parameters again; False: those of `start` will do.
        """
        unknowns = self.unknowns
        # The first step leaves little to tolerances: where an effect is large, the tangent's own
        # error would be absorbed by a similar parameter.
        held = unknowns.deviations(free, prior_std_scale, tight=TIGHT if slopes else 1.0)
        solution = solve(start.normal, held, start.prior_mean)
        fit = start
        for step in range(_STEPS):
            moved = fit.theta.copy()
            for place, index in enumerate(unknowns.indices):
                p = unknowns.parameters[index]
                moved[index] = np.clip(fit.theta[index] + solution.mean[place], p.low, p.high)
            # Every parameter moves: the model is nonlinear within a tolerance too.
            change = max(
                abs(moved[i] - fit.theta[i]) / unknowns.parameters[i].resolution
                for i in unknowns.indices
            )
            if change < _CLOSE:
                break
            # Slopes change little on the way: they are taken again once, residuals every time.
            renewed = free if slopes and step == 0 else ()
            tangent = self._about(moved, renewed, tangent_of(fit))
            prior_mean = fit.prior_mean.copy()
            for place, index in enumerate(unknowns.indices):
                prior_mean[place] = self.theta[index] - moved[index]
            fit = self._solved(free, prior_std_scale, moved, prior_mean, tangent)
            solution = fit.solution
            if step and change < 0.3:
                break
        if fit is start:
            return self._solved(free, prior_std_scale, fit.theta, fit.prior_mean, tangent_of(fit))
        return fit

    def relinearized(self, fit: Fit) -> Fit:
        """Return a fit with the slopes of everything taken where it is, not in the nominal model.

        Wind times drag is not wind plus drag: what tolerances may do depends on what was named.
        """
        again = replace(fit, tangent=self._about(fit.theta, None, tangent_of(fit)))
        again = replace(again, normal=sum_of(again.tangent.normals))
        return self.fit(fit.free, fit.prior_std_scale, again, slopes=False)

    def _about(
        self, theta: Array, renewed: Sequence[int] | None, before: FlightTangent
    ) -> FlightTangent:
        """Return residuals at theta, slopes of the parameters `renewed`, and their equations.

        None: of all of them and of the draws, along the rotor speeds that theta gives.
        """
        fresh = map_flights(
            lambda each: linearize(
                each[0], self.nominal, theta, renewed, each[1],
                None if renewed is None else each[2],
            ),
            list(zip(self.tracks, self.linears, before.linears, strict=True)),
        )  # fmt: skip
        if renewed is None:
            return FlightTangent(tuple(fresh), self._normals(fresh))
        linears = tuple(
            replace(new, slopes={**old.slopes, **new.slopes}, draws=old.draws)
            for new, old in zip(fresh, before.linears, strict=True)
        )
        places = self.unknowns.places(renewed)
        normals = tuple(
            self._equations(linear, f, normal, places)
            for f, (linear, normal) in enumerate(zip(linears, before.normals, strict=True))
        )
        return FlightTangent(linears, normals)

    def _normals(self, linears: Sequence[Linearization]) -> tuple[NormalEquations, ...]:
        return tuple(self._equations(linear, f) for f, linear in enumerate(linears))

    def _equations(
        self,
        linear: Linearization,
        flight: int,
        before: NormalEquations | None = None,
        places: Sequence[int] = (),
    ) -> NormalEquations:
        """Return a flight's normal equations.

        `before`: equations whose slopes are the same, but for those of the columns at `places`.
        """
        count = self.unknowns.count
        vector, square = np.zeros(count), 0.0
        columns = slice(None) if before is None else list(places)
        slopes = np.zeros((count, count if before is None else len(places)))
        for group, residual in linear.residual.items():
            design = self.design(linear, group, flight)
            weighed = design / self.variances[flight][group][:, None, None]
            vector += np.tensordot(weighed, residual, ((0, 2), (1, 0)))
            square += float(np.sum(residual**2 / self.variances[flight][group]))
            slopes += np.tensordot(weighed, design[:, columns], ((0, 2), (0, 2)))
        matrix = np.zeros((count, count)) if before is None else before.matrix.copy()
        matrix[:, columns] = slopes
        matrix[columns] = slopes.T
        return NormalEquations(matrix, vector, square)

    def _rest(self, unknowns: Array) -> dict[tuple[str, str], list[Array]]:
        """Return group and channel -> what unknowns (K,) about the nominal model leave of each."""
        rest: dict[tuple[str, str], list[Array]] = {}
        for f, linear in enumerate(self.linears):
            for group, rows in linear.residual.items():
                left = rows - self._explained(linear, group, f, unknowns)
                for c, column in zip(self.channels[f][group], left.T, strict=True):
                    rest.setdefault((group, c.name), []).append(column)
        return rest

    def _variances(self, unknowns: Array) -> list[dict[str, Array]]:
        """Return the noise of each flight's channels, from the residual of the unknowns."""
        healthy = self.nominal.healthy
        usual: Mapping[str, Sequence[float]] = {} if healthy is None else healthy.residuals
        variances = {
            (group, name): max(
                long_run_variance(rows, self.per_second(group), floors_of(name)[0]),
                long_run_of_scales(usual.get(name, ()), self.per_second(group)),
            )
            for (group, name), rows in self._rest(unknowns).items()
        }
        return [
            {
                group: np.array([variances[group, c.name] for c in ids])
                for group, ids in each.items()
            }
            for each in self.channels
        ]

    def with_spread(self, spread: Mapping[str, float], draw_width: float) -> FlightProblem:
        """Return the problem with these tolerances, and its nominal model anew.

        Args:
            spread: effect.parameter → standard deviation; the others stay.
            draw_width: the same of a draw.
        """
        again = copy(self)
        parameters = tuple(
            replace(p, known_to=spread.get(p.label, p.known_to)) for p in self.unknowns.parameters
        )
        again.unknowns = replace(self.unknowns, parameters=parameters, draw_width=draw_width)
        fit = self.null_hypothesis
        again.null_hypothesis = again._solved(
            (), NOMINAL_WIDTHS, fit.theta, fit.prior_mean, tangent_of(fit)
        )
        return again

    def per_second(self, group: str) -> float:
        """Return how many rows a group has in a second."""
        if group == "fast":
            return 1.0 / FAST_SPACING
        if group == "slow":
            return 1.0 / SLOW_SPACING
        return 1.0 / float(np.median(np.diff(self.tracks[0].pose_t)))


def sum_of(normals: Sequence[NormalEquations]) -> NormalEquations:
    """Return the equations of all flights together."""
    return reduce(operator.add, normals)

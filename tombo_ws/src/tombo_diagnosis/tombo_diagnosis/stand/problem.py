"""All points of a diagnosis as one regression: residuals, slopes, noise, fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tombo_diagnosis.engine.model import Setting
from tombo_diagnosis.engine.regression import (
    NOMINAL_WIDTHS,
    Fit,
    FreeParameter,
    NormalEquations,
    Unknowns,
    solve,
)
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.effects import STAND_EFFECTS, Draws, Setup, predict

_REFERENCE_THRUST_N, _REFERENCE_TORQUE_N_M = 3.0, 0.12
"""N and N m: the largest loads of the stand that the registry's typical sizes are for."""


def parameters(setup: Setup) -> tuple[FreeParameter, ...]:
    """Return the parameters of all effects that make sense for a setup's model."""
    model = "plain" if setup.plain else "tombo"
    scales_with = {
        "": 1.0,
        "thrust": setup.largest_thrust / _REFERENCE_THRUST_N,
        "torque": setup.largest_torque / _REFERENCE_TORQUE_N_M,
    }
    every: list[FreeParameter] = []
    for name, effect in STAND_EFFECTS.items():
        for p in effect.theta if effect.suits(model) else ():
            scale = abs(p.typical - p.null) * scales_with[p.scales_with]
            place = -1 if effect.stochastic else sum(not q.stochastic for q in every)
            every.append(
                FreeParameter(
                    place, name, p.name, p.unit, p.null, *p.bounds, scale, effect.stochastic,
                    effect.healthy_spread,
                )
            )  # fmt: skip
    return tuple(every)


_DERIVATIVE_STEP_SHARE = 0.02
"""Of a numerical derivative, in sizes that matter."""
_SPEED_STEP = 1e-3
"""Of the derivative over speed, as a share of the speed."""
_MAX_FIT_STEPS = 10
_MAX_EVIDENCE_LOSS = 0.05
"""Of log evidence: a step that loses more has gone too far."""
_CONVERGED_STEP_SHARE = 0.02
"""A fit ends when no free parameter moves by more than this share of its size that matters."""
SPEED, PROPELLER, RUN = "speed_noise", "fabrication_scatter", "tare_scatter"
SHARE = "run_scatter"
_DRAWN = {PROPELLER: "propeller", RUN: "run", SHARE: "share"}


_MIN_GROUPS = 3
"""Propellers or runs that are needed to distinguish scatter from a common error."""
_NOISE_EFFECT_PENALTY = 3.0
"""Log Bayes factor that a stochastic effect has to bring besides: how noisy a reading is, a stand
knows to some 15 % only, and its tails are heavy."""
_MIN_SPEEDS_TO_SEPARATE, _FEW_SPEEDS_ERROR_SHARE = 4, 0.3
"""With fewer speeds than this only the priors' widths distinguish causes, and they must not:
causes within this share of the best evidence are in the set."""
_CALIBRATION_NAMED = ((0.0, 0.5), (0.8, 0.6), (0.9, 0.7), (0.97, 0.92), (0.99, 0.975))
CALIBRATION = {
    "none": ((0.0, 0.15), (0.30, 0.2), (0.655, 0.4), (0.929, 0.68), (0.982, 0.87)),
    "named": _CALIBRATION_NAMED,
    "set": _CALIBRATION_NAMED,
    "unknown": ((0.0, 0.45), (0.5, 0.6), (0.9, 0.9), (0.99, 0.99)),
}
"""Found on synthetic cases of other seeds than the reported ones."""


class StandProblem:
    """The regression of operating points about their nominal model: a `Model` of the engine.

    `absorbed` are effects that the nominal model's own fit took up.
    """

    def __init__(
        self,
        points: OperatingPoints,
        absorbed: Sequence[str] = (),
        base: dict[str, tuple[float, ...]] | None = None,
    ) -> None:
        setup = points.setup
        self.points = points
        every = parameters(setup)
        with_mean = tuple(p for p in every if not p.stochastic)
        self.healthy = {p.label: p.tolerance for p in every if p.stochastic}
        self.theta = np.array([p.null for p in with_mean])
        for name, values in (base or {}).items():
            places = [p.index for p in with_mean if p.effect == name]
            self.theta[places] = values[: len(places)]
        self.propellers = len(points.propellers)
        self.runs = len(points.runs)
        self.scatters = not setup.plain
        self.repeated = len(set(zip(setup.propeller, setup.run, strict=True))) > self.propellers
        """Whether a propeller has several runs."""
        # In the order of `_draw_slopes`.
        drawn = (PROPELLER,) * (2 * self.propellers * self.scatters)
        drawn += (RUN,) * (2 * self.runs) + (SHARE,) * (2 * self.runs)
        self.unknowns = Unknowns(with_mean, tuple(range(len(with_mean))), drawn)

        self.left = self.residual(self.theta)
        """(N, 4) measured minus nominal model; 0 where not measured."""
        self.seen = np.isfinite(points.readings) & np.isfinite(self.prediction(self.theta))
        if not self.seen.any():
            raise InputError(
                "no point is within the model's valid speeds; accepted: points that are"
            )
        self.sigma = np.where(self.seen, points.sigma, np.inf)
        self.slopes = self.slopes_at(self.theta)
        """(N, 4, K)"""
        self.drawn = self._draw_slopes()
        change = self._drawn_change({SPEED: (_SPEED_STEP,)}, point=np.ones(points.count))
        self.speed_slope = change / _SPEED_STEP
        """(N, 4): readings per share of speed."""
        size = np.sqrt(np.sum((self.slopes / self.sigma[:, :, None]) ** 2, axis=(0, 1)))
        self.unknowns = replace(
            self.unknowns,
            absorbed=frozenset(p.index for p in with_mean if p.effect in absorbed),
            # Of the size that matters it does not stand out of the noise.
            unobservable=frozenset(p.index for p in with_mean if size[p.index] * p.scale <= 1.0),
        )
        self.setting = Setting(
            max_fitted=99,
            model_error_share=_FEW_SPEEDS_ERROR_SHARE
            if self._speeds() < _MIN_SPEEDS_TO_SEPARATE
            else 0.0,
            calibration=CALIBRATION,
            always_fitted=tuple(n for n, e in STAND_EFFECTS.items() if e.saturates),
        )
        self.null_hypothesis = self._fit((), NOMINAL_WIDTHS, self.theta, self.slopes)

    def noise_effects(self) -> Mapping[str, float]:
        """Return the stochastic effects that these points can tell from a common error.

        Of the shares of runs, runs of one propeller have to differ: each on its own propeller they
        look like fabrication.
        """
        shown = {
            PROPELLER: self.scatters and self.propellers >= _MIN_GROUPS,
            RUN: self.runs >= _MIN_GROUPS or self.repeated,
            SHARE: self.repeated,
            SPEED: True,
        }
        return {e: _NOISE_EFFECT_PENALTY for e in STAND_EFFECTS if shown.get(e, False)}

    def _speeds(self) -> int:
        """Return how many different speeds there are, to one in fifty."""
        speed = self.points.setup.speed
        turning = speed[self.seen.any(axis=1) & (speed > 0.0)]
        return int(np.unique(np.round(50.0 * turning / max(float(speed.max()), 1e-9))).size)

    @property
    def used(self) -> int:
        """Number of points that count: measured, where the model has a root."""
        return int(self.seen.any(axis=1).sum())

    def identifiable(self, effect: str) -> tuple[int, ...]:
        """Return the places of an effect's parameters that can be its cause."""
        parameters = self.unknowns.parameters
        return tuple(k for k in self.unknowns.identifiable if parameters[k].effect == effect)

    def values(self, theta: Array) -> dict[str, tuple[float, ...]]:
        """Return effect -> parameters, as `predict` takes them."""
        result: dict[str, tuple[float, ...]] = {}
        for p, value in zip(self.unknowns.parameters, theta, strict=True):
            result[p.effect] = (*result.get(p.effect, ()), float(value))
        return result

    def prediction(self, theta: Array) -> Array:
        """Return the readings (N, 4) under parameters."""
        return predict(self.points.setup, self.values(theta))

    def residual(self, theta: Array) -> Array:
        """Return measured minus predicted (N, 4), 0 where there is none."""
        left = self.points.readings - self.prediction(theta)
        return np.where(np.isfinite(left), left, 0.0)

    def normal(
        self, theta: Array, slopes: Array, prior_std_scale: Mapping[str, float]
    ) -> tuple[NormalEquations, float]:
        """Return the whitened equations about theta, and half the log of the noise's variance."""
        left = np.where(self.seen, self.residual(theta), 0.0)
        every = np.concatenate([slopes, self.drawn], axis=2)
        return self.whitened(left, every, prior_std_scale)

    def whitened(
        self, left: Array, slopes: Array, prior_std_scale: Mapping[str, float]
    ) -> tuple[NormalEquations, float]:
        """Return equations of any columns (N, 4, K), and half the log determinant."""
        weight = np.where(self.seen, 1.0 / self.sigma, 0.0)
        y = left * weight
        x = slopes * weight[:, :, None]
        # One direction a point is noisier by the speed's noise: a rank-one covariance.
        shared = self.healthy["speed_noise.deviation"] * prior_std_scale.get(SPEED, 1.0)
        g = self.speed_slope * weight * shared
        length = np.sum(g**2, axis=1)
        shrink = np.divide(
            1.0 - 1.0 / np.sqrt(1.0 + length), length, out=np.zeros_like(length), where=length > 0
        )
        y = y - g * (shrink * np.sum(g * y, axis=1))[:, None]
        along = np.einsum("nc,nck->nk", g, x)
        x = x - g[:, :, None] * (shrink[:, None] * along)[:, None, :]
        flat, rows = x.reshape(-1, x.shape[2]), y.reshape(-1)
        half = 0.5 * float(np.sum(np.log1p(length)))
        return NormalEquations(flat.T @ flat, flat.T @ rows, float(rows @ rows)), half

    def fit(self, free: Sequence[int], prior_std_scale: Mapping[str, float], start: Fit) -> Fit:
        """Fit as `Model.fit` says, within bounds; other parameters have the slopes of `start`."""
        return self._fit(free, prior_std_scale, start.theta, start.tangent)

    def _fit(
        self,
        free: Sequence[int],
        prior_std_scale: Mapping[str, float],
        theta: Array,
        slopes: Array,
    ) -> Fit:
        moving = (*free, *self.unknowns.absorbed)
        deviations = self.unknowns.deviations(free, prior_std_scale)
        best: tuple[float, Fit] | None = None
        for _ in range(_MAX_FIT_STEPS if moving else 1):
            slopes = slopes.copy()
            for k in moving:
                slopes[:, :, k] = self.slope(theta, k)
            normal, half = self.normal(theta, slopes, prior_std_scale)
            prior_mean = np.zeros(deviations.size)
            prior_mean[: theta.size] = self.theta - theta
            solution = solve(normal, deviations, prior_mean)
            evidence = solution.evidence - half
            fit = Fit(
                tuple(free), prior_std_scale, theta, prior_mean, solution, normal, evidence, slopes
            )
            if not moving:
                return fit
            inside = evidence - self.unknowns.bounds_penalty(theta, moving, solution)
            if best is not None and inside < best[0] - _MAX_EVIDENCE_LOSS:
                # Too far, where the model bends: halfway back, and try again from there.
                if float(np.abs(theta - best[1].theta)[list(moving)].max()) == 0.0:
                    break
                theta = 0.5 * (theta + best[1].theta)
                continue
            best = inside, fit
            moved = self._moved(theta, moving, solution.mean)
            scales = np.array([self.unknowns.parameters[k].scale for k in moving])
            change = np.abs(moved - theta)[list(moving)] / scales
            theta = moved
            if float(change.max()) < _CONVERGED_STEP_SHARE:
                break
        assert best is not None
        return best[1]

    def relinearized(self, fit: Fit) -> Fit:
        """Return a fit with the slopes of all parameters where it ended.

        Far from the nominal model what stays within its tolerance acts differently: with the other
        in-plane term, or a stiff twist, the torsion constant hardly matters.
        """
        if not fit.free:
            return fit
        return self._fit(fit.free, fit.prior_std_scale, fit.theta, self.slopes_at(fit.theta))

    def evidence_with(
        self, fit: Fit, prior_std_scale: Mapping[str, float], tight: float = 1.0
    ) -> float:
        """Return the log evidence of a fit with other widths of random effects, by its tangent."""
        normal, half = self.normal(fit.theta, fit.tangent, prior_std_scale)
        deviations = self.unknowns.deviations(fit.free, prior_std_scale, tight)
        return solve(normal, deviations, fit.prior_mean, covariance=False).evidence - half

    def _moved(self, theta: Array, moving: Sequence[int], mean: Array) -> Array:
        """Return theta after a step, shortened until all measured points have a root."""
        for factor in (1.0, 0.5, 0.25, 0.1):
            moved = theta.copy()
            for k in moving:
                p = self.unknowns.parameters[k]
                step = float(np.clip(mean[k], -2.0 * p.scale, 2.0 * p.scale))
                moved[k] = np.clip(theta[k] + factor * step, p.low, p.high)
            if np.isfinite(self.prediction(moved)[self.seen]).all():
                return moved
        return theta

    def final(self, fit: Fit) -> Array:
        """Return the parameters of a fit, its last step taken, others at their nominal value."""
        return self._moved(fit.theta, (*fit.free, *self.unknowns.absorbed), fit.solution.mean)

    def unexplained(self, fit: Fit) -> Array:
        """Return the residual of a fit (N, 4), its random draws removed."""
        wide = [fit.prior_std_scale.get(effect, 1.0) > 1.0 for effect in self.unknowns.draws]
        drawn = self.drawn @ np.where(wide, fit.solution.mean[len(self.unknowns.indices) :], 0.0)
        return np.where(self.seen, self.residual(self.final(fit)) - drawn, 0.0)

    def slopes_at(self, theta: Array) -> Array:
        """Return the derivatives of the readings (N, 4, K) over all parameters."""
        return np.stack(
            [self.slope(theta, k) for k in range(len(self.unknowns.parameters))], axis=2
        )

    def slope(self, theta: Array, k: int) -> Array:
        """Return the derivative of the readings (N, 4) over a parameter."""
        p = self.unknowns.parameters[k]
        step = _DERIVATIVE_STEP_SHARE * p.scale
        up, down = theta.copy(), theta.copy()
        up[k] = min(theta[k] + step, p.high)
        down[k] = max(theta[k] - step, p.low)
        rise = self.prediction(up) - self.prediction(down)
        slope = rise / (up[k] - down[k])
        return np.where(np.isfinite(slope), slope, 0.0)

    def _draw_slopes(self) -> Array:
        """Return readings per unit draw of each propeller and run, (N, 4, 2 P + 4 R)."""
        setup = self.points.setup
        columns: list[Array] = []
        groups = [(PROPELLER, setup.propeller, self.propellers)] if self.scatters else []
        by_run = [(name, setup.run, self.runs) for name in (RUN, SHARE)]
        for name, number, count in [*groups, *by_run]:
            deviations = [self.healthy[f"{name}.{p.name}"] for p in STAND_EFFECTS[name].theta]
            for j in range(2):
                table = np.zeros((count, 2))
                table[:, j] = 1.0
                change = self._drawn_change({name: tuple(deviations)}, **{_DRAWN[name]: table})
                columns += [change * (number == k)[:, None] for k in range(count)]
        return np.stack(columns, axis=2)

    def _drawn_change(self, deviations: dict[str, tuple[float, ...]], **draws: Array) -> Array:
        """Return what draws change of the readings (N, 4), under an effect of these deviations."""
        drawn = replace(Draws.none(self.points.setup), **draws)
        changed = predict(self.points.setup, self.values(self.theta) | deviations, drawn)
        change = changed - self.prediction(self.theta)
        return np.where(np.isfinite(change), change, 0.0)

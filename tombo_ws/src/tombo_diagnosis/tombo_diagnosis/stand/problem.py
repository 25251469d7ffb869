"""All points of a diagnosis as one regression: residuals, slopes, noise, and what fits them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.flight.evidence import NormalEquations, Posterior, solve
from tombo_diagnosis.stand.operating_points import OperatingPoints
from tombo_diagnosis.stand.parameters import HEALTHY_SHARE, Parameter, parameters
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.effects import STAND_EFFECTS, Draws, predict

Array = NDArray[np.float64]

_STEP = 0.02
"""Of a numerical derivative, in sizes that matter."""
_STEPS = 10
_WORSE = 0.05
"""Of log evidence: a step that loses more has gone too far."""
_CLOSE = 0.02
"""A fit ends when no free parameter moves by more than this share of its size that matters."""
SPEED, PROPELLER, RUN = "speed_noise", "fabrication_scatter", "tare_scatter"
SHARE = "run_scatter"
_DRAWN = {PROPELLER: "propeller", RUN: "run", SHARE: "share"}


@dataclass(frozen=True)
class Widths:
    """Factors on the healthy widths of the effects of chance."""

    propeller: float = 1.0
    run: float = 1.0
    speed: float = 1.0
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of freed parameters, fitted; all else within its tolerance."""

    free: tuple[int, ...]
    widths: Widths
    theta: Array
    """(K,) parameters: free ones fitted, the others at their nominal value."""
    solution: Posterior
    """About theta; parameters, then the draws of propellers and runs."""
    evidence: float
    """Logarithm of the probability of the data, bounds taken into account."""
    normal: NormalEquations


class Problem:
    """The regression about the nominal model; `absorbed` are effects that its own fit took up."""

    def __init__(
        self,
        points: OperatingPoints,
        absorbed: Sequence[str] = (),
        base: dict[str, tuple[float, ...]] | None = None,
    ) -> None:
        setup = points.setup
        self.points = points
        every = parameters(setup)
        self.parameters = tuple(p for p in every if not p.stochastic)
        self.healthy = {p.label: HEALTHY_SHARE[p.effect] * p.scale for p in every if p.stochastic}
        self.absorbed = frozenset(k for k, p in enumerate(self.parameters) if p.effect in absorbed)
        self.nominal = np.array([p.null for p in self.parameters])
        for name, values in (base or {}).items():
            own = [k for k, p in enumerate(self.parameters) if p.effect == name]
            self.nominal[own] = values[: len(own)]
        self.propellers = len(points.propellers)
        self.runs = len(points.runs)
        self.scatters = not setup.plain
        self.repeated = len(set(zip(setup.propeller, setup.run, strict=True))) > self.propellers
        """Whether a propeller has several runs."""
        self._draws = Draws.none(setup)
        self.left = self.residual(self.nominal)
        """(N, 4) measured minus nominal model; 0 where not measured."""
        self.seen = np.isfinite(points.readings) & np.isfinite(self.prediction(self.nominal))
        if not self.seen.any():
            raise InputError(
                "no point is within the model's valid speeds; accepted: points that are"
            )
        self.sigma = np.where(self.seen, points.sigma, np.inf)
        self.slopes = self.slopes_at(self.nominal)
        """(N, 4, K)"""
        self.drawn = self._draw_slopes()
        self.speed_slope = self._by_speed()
        """(N, 4): readings per share of speed."""
        size = np.sqrt(np.sum((self.slopes / self.sigma[:, :, None]) ** 2, axis=(0, 1)))
        scales = np.array([p.scale for p in self.parameters])
        self.excited = size * scales > 1.0
        """(K,) whether a parameter of the size that matters stands out of the noise."""
        self.null_hypothesis = self.fit(())

    @property
    def used(self) -> int:
        """Number of points that count: measured, where the model has a root."""
        return int(self.seen.any(axis=1).sum())

    def identifiable(self, effect: str) -> tuple[int, ...]:
        """Return the places of an effect's parameters that can be its cause."""
        return tuple(
            k
            for k, p in enumerate(self.parameters)
            if p.effect == effect and self.excited[k] and k not in self.absorbed
        )

    def values(self, theta: Array) -> dict[str, tuple[float, ...]]:
        """Return effect -> parameters, as `predict` takes them."""
        result: dict[str, tuple[float, ...]] = {}
        for p, value in zip(self.parameters, theta, strict=True):
            result[p.effect] = (*result.get(p.effect, ()), float(value))
        return result

    def prediction(self, theta: Array, draws: Draws | None = None) -> Array:
        """Return the readings (N, 4) under parameters."""
        return predict(self.points.setup, self.values(theta), draws)

    def residual(self, theta: Array) -> Array:
        """Return measured minus predicted (N, 4), 0 where there is none."""
        left = self.points.readings - self.prediction(theta)
        return np.where(np.isfinite(left), left, 0.0)

    def deviations(self, free: Sequence[int], widths: Widths, held: float = 1.0) -> Array:
        """Return the prior standard deviations of parameters and draws."""
        own = np.array([p.tolerance for p in self.parameters]) * held
        for k in (*free, *self.absorbed):
            own[k] = self.parameters[k].scale
        return np.concatenate([own, self._draw_widths(widths)])

    def _draw_widths(self, widths: Widths) -> Array:
        propellers = np.full(2 * self.propellers * self.scatters, widths.propeller)
        runs = np.repeat([widths.run, widths.share], 2 * self.runs)
        return np.concatenate([propellers, runs])

    def normal(self, theta: Array, slopes: Array, widths: Widths) -> tuple[NormalEquations, float]:
        """Return the whitened equations about theta, and half the log of the noise's variance."""
        left = np.where(self.seen, self.residual(theta), 0.0)
        every = np.concatenate([slopes, self.drawn], axis=2)
        return self.whitened(left, every, widths)

    def whitened(
        self, left: Array, slopes: Array, widths: Widths
    ) -> tuple[NormalEquations, float]:
        """Return equations of any columns (N, 4, K), and half the log determinant."""
        weight = np.where(self.seen, 1.0 / self.sigma, 0.0)
        y = left * weight
        x = slopes * weight[:, :, None]
        # One direction a point is noisier by the speed's noise: a rank-one covariance.
        shared = self.healthy["speed_noise.deviation"] * widths.speed
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

    def fit(
        self,
        free: Sequence[int],
        widths: Widths = Widths(),
        start: Array | None = None,
        slopes: Array | None = None,
    ) -> Fit:
        """Fit parameters by the model itself, within their bounds.

        Args:
            free: places of the parameters.
            widths: of the effects of chance.
            start: parameters (K,) to begin with.
            slopes: (N, 4, K) for what stays within its tolerance; None: nominal.
        """
        free = tuple(free)
        moving = (*free, *self.absorbed)
        theta = self.nominal.copy() if start is None else start.copy()
        deviations = self.deviations(free, widths)
        slopes = (self.slopes if slopes is None else slopes).copy()
        best: Fit | None = None
        for _ in range(_STEPS if moving else 1):
            for k in moving:
                slopes[:, :, k] = self.slope(theta, k)
            normal, half = self.normal(theta, slopes, widths)
            prior_mean = np.zeros(deviations.size)
            prior_mean[: theta.size] = self.nominal - theta
            solution = solve(normal, deviations, prior_mean)
            evidence = solution.evidence - half - self._outside(moving, theta, solution)
            found = Fit(free, widths, theta.copy(), solution, evidence, normal)
            if not moving:
                best = found
                break
            if best is not None and evidence < best.evidence - _WORSE:
                # Too far, where the model bends: halfway back, and try again from there.
                if float(np.abs(theta - best.theta)[list(moving)].max()) == 0.0:
                    break
                theta = 0.5 * (theta + best.theta)
                continue
            best = found
            moved = self._moved(theta, moving, solution.mean)
            scales = np.array([self.parameters[k].scale for k in moving])
            change = np.abs(moved - theta)[list(moving)] / scales
            theta = moved
            if float(change.max()) < _CLOSE:
                break
        assert best is not None
        return best

    def refined(self, fit: Fit) -> Fit:
        """Return a fit with the slopes of all parameters where it ended.

        Far from the nominal model what stays within its tolerance acts differently: beside the
        other in-plane term, or with a stiff twist, the torsion constant hardly matters any more.
        """
        return self.fit(fit.free, fit.widths, fit.theta, self.slopes_at(fit.theta))

    def _moved(self, theta: Array, moving: Sequence[int], mean: Array) -> Array:
        """Return theta after a step, shortened until all measured points have a root."""
        for factor in (1.0, 0.5, 0.25, 0.1):
            moved = theta.copy()
            for k in moving:
                p = self.parameters[k]
                step = float(np.clip(mean[k], -2.0 * p.scale, 2.0 * p.scale))
                moved[k] = np.clip(theta[k] + factor * step, p.low, p.high)
            if np.isfinite(self.prediction(moved)[self.seen]).all():
                return moved
        return theta

    def _outside(self, moving: Sequence[int], theta: Array, solution: Posterior) -> float:
        cost = 0.0
        for k in moving:
            p = self.parameters[k]
            value = theta[k] + float(solution.mean[k])
            over = max(p.low - value, value - p.high, 0.0)
            if over > 0.0:
                deviation = math.sqrt(max(float(solution.covariance[k, k]), 0.0)) + p.tolerance
                cost += 0.5 * (over / deviation) ** 2
        return min(cost, 1e6)

    def final(self, fit: Fit) -> Array:
        """Return the parameters of a fit, its last step taken, others at their nominal value."""
        return self._moved(fit.theta, (*fit.free, *self.absorbed), fit.solution.mean)

    def unexplained(self, fit: Fit) -> Array:
        """Return what a fit leaves (N, 4), with what its effects of chance did undone."""
        wide = self._draw_widths(fit.widths) > 1.0
        drawn = self.drawn @ np.where(wide, fit.solution.mean[len(self.parameters) :], 0.0)
        return np.where(self.seen, self.residual(self.final(fit)) - drawn, 0.0)

    def slopes_at(self, theta: Array) -> Array:
        """Return the derivatives of the readings (N, 4, K) over all parameters."""
        return np.stack([self.slope(theta, k) for k in range(len(self.parameters))], axis=2)

    def slope(self, theta: Array, k: int) -> Array:
        """Return the derivative of the readings (N, 4) over a parameter."""
        p = self.parameters[k]
        step = _STEP * p.scale
        up, down = theta.copy(), theta.copy()
        up[k] = min(theta[k] + step, p.high)
        down[k] = max(theta[k] - step, p.low)
        rise = self.prediction(up) - self.prediction(down)
        slope = rise / (up[k] - down[k])
        return np.where(np.isfinite(slope), slope, 0.0)

    def _draw_slopes(self) -> Array:
        """Return readings per unit draw of each propeller and run, (N, 4, 2 P + 4 R)."""
        setup = self.points.setup
        n = setup.speed.size
        columns: list[Array] = []
        groups = [(PROPELLER, setup.propeller, self.propellers)] if self.scatters else []
        by_run = [(name, setup.run, self.runs) for name in (RUN, SHARE)]
        for name, number, count in [*groups, *by_run]:
            widths = [self.healthy[f"{name}.{p.name}"] for p in STAND_EFFECTS[name].theta]
            for j in range(2):
                table = np.zeros((count, 2))
                table[:, j] = 1.0
                drawn = replace(self._draws, **{_DRAWN[name]: table})
                values = self.values(self.nominal) | {name: tuple(widths)}
                change = predict(setup, values, drawn) - self.prediction(self.nominal)
                change = np.where(np.isfinite(change), change, 0.0)
                for k in range(count):
                    columns.append(change * (number == k)[:, None])
        # By propeller, then the tare and the share by run, in the order of `_draw_widths`.
        return np.stack(columns, axis=2) if columns else np.zeros((n, 4, 0))

    def _by_speed(self) -> Array:
        drawn = replace(self._draws, point=np.ones(self.points.count))
        share = 1e-3
        values = self.values(self.nominal) | {SPEED: (share,)}
        change = predict(self.points.setup, values, drawn) - self.prediction(self.nominal)
        return np.where(np.isfinite(change), change, 0.0) / share

    def parameter(self, k: int) -> Parameter:
        """Return a parameter by its place."""
        return self.parameters[k]

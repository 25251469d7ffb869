"""How each channel changes with each parameter: derivatives of the residuals, by differences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from tombo_diagnosis.engine.regression import FreeParameter
from tombo_diagnosis.flight.fit.prediction import (
    OF_POSES,
    MotionOfPoses,
    motion_of,
    residuals,
    simulate_along_motion,
)
from tombo_diagnosis.flight.fit.track import TICK, Track
from tombo_diagnosis.flight.noise import with_pose_noise
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY, Stage

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
Groups = dict[str, Array]

_MAX_NOISE_SHARE = 0.1
"""Share of a slope's energy in a channel that noise may have."""
_FOLLOWED = frozenset(
    name
    for name, e in REGISTRY.items()
    if e.state and e.stage is Stage.WRENCH and not (e.stochastic or e.contact or e.vibration)
)
"""Effects whose force depends on the motion of before: it is followed from the log's begin."""
_MAX_LOST_SHARE = 0.1
"""Share of that force by which it may differ with other noise of the poses: beyond, the memory is
lost. A thread that was slack makes a small difference grow tenfold in a second or two."""
_LOST_WINDOW_S, _LOST_BEFORE_S = 0.5, 1.0
"""s: over which the difference is taken; and how long before it shows it may have begun."""
_REPLICAS = 3
"""Draws of the noise that are compared."""
ROTOR_DRAWS = 4
"""Draws of the vehicle that effects use: one a rotor."""


@dataclass(frozen=True)
class Linearization:
    """A flight's residuals about one theta: left(theta + d) = left - sum of slopes * d."""

    theta: Array
    driver: Track
    """The flight with the rotor speeds along which steps and slopes are taken."""
    start_along: Groups
    """Residual of the start of the fit along them: group -> (rows, channels)."""
    motion: MotionOfPoses
    """Behind the measured poses, of these parameters."""
    residual: Groups
    """group -> (rows, channels)."""
    slopes: dict[int, Groups]
    """Index in theta -> group -> (rows, channels): change of the prediction per unit."""
    draws: dict[int, Groups]
    """The same for those of the vehicle's draws that do something."""
    draw_width: float = 1.0
    """Standard deviation of these unknowns in the nominal model."""
    lost: Mapping[str, float] = field(default_factory=dict)
    """Effect with a memory -> time after which poses of this noise no longer show it [s]."""
    noisy: Mapping[int, NDArray[np.bool_]] = field(default_factory=dict)
    """Index in theta -> (channels of the group slow): where its slope is noise of the poses, which
    is in the residuals too. There the slope is taken as zero: no evidence comes from it."""


@dataclass(frozen=True)
class _PredictedFlight:
    """A flight compared with a model at one theta."""

    track: Track
    nominal: NominalModel
    theta: Array
    motion: MotionOfPoses

    @cached_property
    def residual(self) -> Groups:
        """Residual at this theta."""
        return residuals(self.track, self.nominal, self.theta, self.motion)

    def slope(self, p: FreeParameter) -> Groups | None:
        """Return the change of the prediction per unit of a parameter; None: none."""
        moved = self.theta.copy()
        # Within the parameter's bounds.
        step = p.step if float(moved[p.index]) + p.step <= p.high else -p.step
        moved[p.index] += step
        motion = None if p.index in OF_POSES else self.motion
        return _change(self.residual, residuals(self.track, self.nominal, moved, motion), step)


def _change(before: Groups, after: Groups, step: float) -> Groups | None:
    change = {group: (before[group] - after[group]) / step for group in before}
    return change if any(np.any(c) for c in change.values()) else None


def linearize(
    track: Track,
    nominal: NominalModel,
    theta: Array,
    indices: Sequence[int] | None = None,
    start: Linearization | None = None,
    along: Linearization | None = None,
) -> Linearization:
    """Return residuals and slopes of a flight about `theta`.

    `indices` are those to differentiate; None: all of the registry, and the draws. `start` is the
    same about other parameters: the residuals then include the change by the step from there,
    along the commanded rotor speeds, as for slopes. `along` has these speeds, where slopes of
    other parameters were taken along them: along others, two parameters that are alike would
    differ by what a delay does. None: those of `theta`.
    """
    motion = motion_of(track, nominal, theta)
    driver = along.driver if along else _with_commanded_speeds(track, nominal, theta, motion)
    here = _PredictedFlight(driver, nominal, theta, motion)
    start_along = base = here.residual
    if driver is track:
        residual = base
    elif start is None:
        residual = residuals(track, nominal, theta, motion)
    else:
        start_along = (
            along.start_along if along else residuals(driver, nominal, start.theta, start.motion)
        )
        residual = {g: start.residual[g] + (base[g] - start_along[g]) for g in base}
    slopes = {}
    for p in nominal.parameters:
        if (indices is None or p.index in indices) and not REGISTRY[p.effect].vibration:
            change = here.slope(p)
            if change is not None:
                slopes[p.index] = change
    noisy = {} if start is None else start.noisy
    lost = {} if start is None else start.lost
    if start is None:
        lost = _lost_memories(here, slopes)
    if start is None and not nominal.calibrated:
        replica = _replica(track, nominal, theta, 0)
        noisy = {
            i: _where_noise(replica, nominal.parameters[i], change)
            for i, change in slopes.items()
            if i in OF_POSES
        }
    for index, where in noisy.items():
        if index in slopes:
            slopes[index]["slow"][:, where] = 0.0
    draws: dict[int, Groups] = {}
    width = 1.0
    if indices is None:
        spread, width = with_scatter(theta, nominal)
        for i in range(ROTOR_DRAWS):
            drawn = np.zeros(8)
            drawn[i] = 0.5
            change = _change(base, residuals(driver, nominal, spread, motion, drawn), 0.5)
            if change is not None:
                draws[i] = change
    return Linearization(
        theta, driver, start_along, motion, residual, slopes, draws, width, lost, noisy
    )


def _replica(track: Track, nominal: NominalModel, theta: Array, seed: int) -> _PredictedFlight:
    """Return the flight with the noise of its poses once more."""
    again = with_pose_noise(track, nominal, theta, seed)
    return _PredictedFlight(again, nominal, theta, motion_of(again, nominal, theta))


def _lost_memories(here: _PredictedFlight, slopes: Mapping[int, Groups]) -> dict[str, float]:
    """Return effect -> from when on the noise of the poses decides what it does [s].

    A load that was thrown up by a quick flight falls back into its thread, and the smallest error
    decides where it swings then.
    """
    group = "fast" if "fast" in here.residual else "slow"
    times = here.track.times(group)
    window = max(round(_LOST_WINDOW_S / float(np.median(np.diff(times)))), 1)
    lost: dict[str, float] = {}
    followed = [i for i in slopes if here.nominal.parameters[i].effect in _FOLLOWED]
    for seed in range(_REPLICAS if followed else 0):
        replica = _replica(here.track, here.nominal, here.theta, seed)
        for index in followed:
            p, change = here.nominal.parameters[index], slopes[index][group]
            again = replica.slope(p)
            if again is None:
                continue
            size = float(np.sqrt(np.mean(np.sum(change**2, axis=1))))
            square = np.sum((again[group] - change) ** 2, axis=1)
            apart = uniform_filter1d(square, window) > (_MAX_LOST_SHARE * size) ** 2
            if apart.any():
                begin = float(times[np.argmax(apart)]) - _LOST_BEFORE_S
                lost[p.effect] = min(begin, lost.get(p.effect, begin))
    return lost


def _with_commanded_speeds(
    track: Track, nominal: NominalModel, theta: Array, motion: MotionOfPoses
) -> Track:
    """Return the flight with the rotor speeds that its commands ask for in place of measured ones.

    The noise of measured speeds is in the residuals; in the slopes too, the two would agree, and
    where a flight hardly yaws, an inertia that is too large would take that noise away. Slopes
    from the commands are instruments: they know nothing of it. The same holds for the steps of a
    fit: stronger thrust would else be charged for making more of that noise.
    """
    if not (track.speed.size and track.command.size):
        return track
    speed = simulate_along_motion(track, nominal, theta, motion)["rotor_speed"]
    both = np.column_stack([speed, np.gradient(speed, TICK, axis=0)])
    return replace(track, channels={**track.channels, "rotor_speed": both})


def _where_noise(replica: _PredictedFlight, p: FreeParameter, change: Groups) -> NDArray[np.bool_]:
    """Return in which channels of the group slow a slope is noise of the poses to a good part.

    Where a flight hardly turns, the regressor of a marker offset is the attitude's noise,
    differentiated twice; a fit would find an offset in every flight. `replica` has it once more.
    """
    again = replica.slope(p)
    energy = np.sum(change["slow"] ** 2, axis=0)
    shaken = energy if again is None else np.sum(again["slow"] ** 2, axis=0)
    return np.asarray(shaken - energy > _MAX_NOISE_SHARE * energy)


def with_scatter(theta: Array, nominal: NominalModel) -> tuple[Array, float]:
    """Return theta with the effects of the draws on, and the size of a draw in healthy flights.

    A nominal model without scatter has no slope with the draws: it is taken at a tenth of the size
    that matters. A healthy draw is the scatter over that, or its tolerance where that is more.
    """
    p = nominal.scatter
    spread = theta.copy()
    spread[p.index] = unit = scatter_unit(theta, nominal)
    return spread, max(float(theta[p.index]), p.tolerance) / unit


def scatter_unit(theta: Array, nominal: NominalModel) -> float:
    """Return the relative deviation of thrust for a draw of 1."""
    return max(float(theta[nominal.scatter.index]), nominal.scatter.step)


def map_flights(function: Callable[[_Item], _Result], flights: Sequence[_Item]) -> list[_Result]:
    """Apply to every flight, on two threads: compiled code does not hold the interpreter."""
    with ThreadPoolExecutor(2, "flights") as pool:
        return list(pool.map(function, flights))

"""What causes leave over of force and moment in flights, and the variables that it follows.

A variable counts if it predicts the leftover of flights that were held out. The prediction is the
mean of the other flights in slices of the variable: no shape is assumed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import pandas as pd

from tombo_diagnosis.diagnosis import VARIABLES, Dependence, Leftover, LeftoverSamples
from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.prediction import simulate_along_motion
from tombo_diagnosis.flight.fit.problem import FlightProblem, tangent_of
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_logs.checks.spans import block_means

_BLOCK_S = 0.24
"""Means over such blocks are compared and drawn."""
_QUANTITIES = ("force", "moment")
_SLICES = 10
"""Number of slices of a variable, with equally many samples each."""
_MIN_R2 = 0.1
"""Share of the leftover of held-out flights that a variable has to predict."""
_MAX_VARIABLES = 3
"""Named for each quantity."""


def flight_leftover(problem: FlightProblem, fit: Fit, groups: Collection[str] = ()) -> Leftover:
    """Return the force and moment that neither a fit nor its tolerances explain.

    Only those among `groups` of unexplained channels, if any of them is.
    """
    quantities = [q for q in _QUANTITIES if q in groups] or [*_QUANTITIES]
    flights = range(len(problem.tracks))
    by_quantity = {q: [_samples(problem, fit, f, q) for f in flights] for q in quantities}
    measured = {q: [s for s in each if s is not None] for q, each in by_quantity.items()}
    measured = {q: each for q, each in measured.items() if each}
    return Leftover(
        tuple(d for q, each in measured.items() for d in dependences(q, each)),
        {q: _rms([s.body for s in each]) for q, each in measured.items()},
        tuple(s for each in measured.values() for s in each),
    )


def dependences(quantity: str, flights: Sequence[LeftoverSamples]) -> list[Dependence]:
    """Return the variables that a quantity's leftover follows in held-out flights, best first."""
    tried = []
    for frame in ("body", "map"):
        values = [s.body if frame == "body" else s.map for s in flights]
        for name in VARIABLES:
            known = [s.state[name] for s in flights if name in s.state]
            if len(known) == len(flights):
                tried.append(Dependence(quantity, name, frame, held_out_r2(known, values)))
    best: dict[str, Dependence] = {}
    for each in sorted(tried, key=lambda d: -d.r2):
        if each.r2 >= _MIN_R2:
            best.setdefault(each.variable, each)
    return list(best.values())[:_MAX_VARIABLES]


def held_out_r2(x: Sequence[Array], y: Sequence[Array]) -> float:
    """Return the share of vectors y that their means over x in the other flights predict.

    Args:
        x: variable of each flight, (M,).
        y: vectors of each flight, (M, 3); an axis that is NaN anywhere is left out.
    """
    axes = np.isfinite(np.vstack(y)).all(axis=0)
    before = after = 0.0
    for held in range(len(x)):
        others = [k for k in range(len(x)) if k != held]
        if not others:
            return 0.0
        known, target = np.concatenate([x[k] for k in others]), np.vstack([y[k] for k in others])
        edges = np.quantile(known, np.linspace(0.0, 1.0, _SLICES + 1)[1:-1])
        place = np.searchsorted(edges, known, side="right")
        means = pd.DataFrame(target[:, axes]).groupby(place).mean()
        means = means.reindex(range(_SLICES), fill_value=0.0).to_numpy()
        predicted = means[np.searchsorted(edges, x[held], side="right")]
        before += float(np.sum(y[held][:, axes] ** 2))
        after += float(np.sum((y[held][:, axes] - predicted) ** 2))
    return 1.0 - after / before if before > 0.0 else 0.0


def _samples(
    problem: FlightProblem, fit: Fit, flight: int, quantity: str
) -> LeftoverSamples | None:
    """Return one flight's leftover; None where its channels do not show the quantity."""
    track, linear = problem.tracks[flight], tangent_of(fit).linears[flight]
    group, chosen = problem.rows_of(flight, quantity)
    if not chosen:
        return None
    names = [problem.channels[flight][group][k].name for k in chosen]
    axes = ["xyz".index(name[-1]) for name in names]
    kernel = track.kernel(group)
    length = max(1, round(_BLOCK_S * problem.per_second(group)))
    vehicle = problem.nominal.vehicle
    inertia = np.array([vehicle.inertia_xx, vehicle.inertia_yy, vehicle.inertia_zz])
    size = np.full(3, vehicle.mass) if quantity == "force" else inertia
    rows = problem.residual(fit, flight)[group][:, chosen]
    left = block_means(rows, length) * size[axes]
    rotation = linear.motion.rotation
    turned = block_means(kernel.smooth @ rotation.reshape(-1, 9), length).reshape(-1, 3, 3)
    body = np.full((len(left), 3), np.nan)
    body[:, axes] = left
    if names[0].startswith("acceleration"):
        body = np.einsum("nji,nj->ni", turned, body)  # of axes in map
    state = _state(problem, fit, flight)
    means = {name: block_means(kernel.smooth @ v, length) for name, v in state.items()}
    return LeftoverSamples(track.name, quantity, means, turned, body)


def _rms(values: Sequence[Array]) -> float:
    every = np.vstack(values)
    known = np.isfinite(every).any(axis=0)  # an axis may not be compared at all
    return float(np.sqrt(np.nanmean(every[:, known] ** 2, axis=0).sum()))


def _state(problem: FlightProblem, fit: Fit, flight: int) -> dict[str, Array]:
    """Return the variables that a leftover may follow, at the ticks of a flight."""
    track, motion = problem.tracks[flight], tangent_of(fit).linears[flight].motion
    values = motion.state
    body = np.einsum("nji,nj->ni", motion.rotation, values[:, 3:6])
    state = dict(zip(("x", "y", "z", "vx", "vy", "vz"), values[:, :6].T, strict=True))
    state |= dict(zip("uvw", body.T, strict=True))
    state |= dict(zip("pqr", values[:, 10:13].T, strict=True))
    state["yaw"] = yaw_pitch_roll(values[:, 6:10])[:, 0]
    state["t"] = track.t - track.t[0]
    out = simulate_along_motion(track, problem.nominal, fit.theta, motion)
    # drag along the axis is small
    state["thrust"] = problem.nominal.vehicle.mass * out["force"][:, 2]
    if track.voltage.size:
        state["voltage"] = track.voltage[:, 0]
    return state

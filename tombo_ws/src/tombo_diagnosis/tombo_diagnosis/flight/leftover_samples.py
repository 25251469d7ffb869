"""The leftover of flights under an explanation: force and moment, ready for a sparse fit."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.prediction import MotionOfPoses, simulate_along_motion
from tombo_diagnosis.flight.fit.problem import FlightProblem, tangent_of
from tombo_diagnosis.leftover.leftover import Leftover, Measured, leftover_of
from tombo_diagnosis.leftover.terms import Extent, Term, force_terms, moment_terms
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_logs.checks.spans import block_means

_BLOCK_S = 0.24
"""Means over such blocks are fitted and drawn."""
_CORRELATED_S = 2.0
"""Blocks of one such stretch count as one sample in intervals."""
_CHANNELS = {"force": ("force", "acceleration"), "moment": ("turning",)}


def flight_leftover(
    problem: FlightProblem, fit: Fit, quantities: Collection[str] = tuple(_CHANNELS)
) -> Leftover:
    """Return what a fit leaves of force, moment or both, its tolerances as likely as they are.

    What is free in the fit takes no part: terms that look like it are not found again.
    """
    terms = {"force": force_terms(_extent(problem, fit)), "moment": moment_terms()}
    measured = {}
    for quantity in quantities:
        dictionary = terms[quantity]
        flights = [
            _measured(problem, fit, f, quantity, dictionary) for f in range(len(problem.tracks))
        ]
        samples = [each for each in flights if each is not None]
        if samples:
            measured[quantity] = samples
    return leftover_of(measured, terms)


def leftover_quantities(groups: Collection[str]) -> tuple[str, ...]:
    """Return which quantities the groups of unexplained channels ask for; all without any."""
    return tuple(q for q in _CHANNELS if q in groups) or tuple(_CHANNELS)


def _extent(problem: FlightProblem, fit: Fit) -> Extent:
    places = np.vstack([
        track.slow_kernel.smooth @ linear.motion.state[:, :2]
        for track, linear in zip(problem.tracks, tangent_of(fit).linears, strict=True)
    ])  # fmt: skip
    volts = [track.voltage for track in problem.tracks]
    known = all(v.size for v in volts)
    voltage = float(np.mean([v.mean() for v in volts])) if known else math.nan
    return Extent(places, voltage)


def _measured(
    problem: FlightProblem, fit: Fit, flight: int, quantity: str, terms: Sequence[Term]
) -> Measured | None:
    """Return one flight's leftover; None where its channels do not show the quantity."""
    track, linear = problem.tracks[flight], tangent_of(fit).linears[flight]
    shown = _channels(problem, flight, quantity)
    if shown is None:
        return None
    group, chosen, axes = shown
    names = problem.channels[flight][group]
    frame = "map" if names[chosen[0]].name.startswith("acceleration") else "body"
    kernel = track.fast_kernel if group == "fast" else track.slow_kernel
    length = max(1, round(_BLOCK_S * problem.per_second(group)))
    vehicle = problem.nominal.vehicle
    size = np.full(3, vehicle.mass) if quantity == "force" else _inertia(vehicle)
    scale = size[list(axes)]
    state = _state(problem, fit, flight)
    rotation = linear.motion.rotation
    vectors = [term.values(state, rotation) for term in terms]
    if frame == "map":
        vectors = [np.einsum("nij,nj->ni", rotation, each) for each in vectors]
    design = np.stack(
        [block_means(kernel.smooth @ each[:, list(axes)], length) for each in vectors], axis=2
    )
    columns = problem.columns
    widths = columns.deviations(fit.free, fit.widths, pinned=fit.pinned)
    slopes = problem.design(linear, group, flight)[chosen] * widths[None, :, None]
    nuisance = block_means(np.transpose(slopes, (2, 0, 1)), length) * scale[:, None]
    rows = problem.residual(fit, flight, _unknowns(problem, fit))[group][:, chosen]
    target = block_means(rows, length) * scale
    # From one block to the next: what is slower is the leftover itself. Too small an estimate
    # leaves less to find, as tolerances then take all that they can.
    noise = np.maximum(np.diff(target, axis=0).std(axis=0) / math.sqrt(2.0), 1e-9)
    t = block_means(track.times(group), length) - track.t[0]
    turned = block_means(kernel.smooth @ rotation.reshape(-1, 9), length).reshape(-1, 3, 3)
    means = {name: block_means(kernel.smooth @ v, length) for name, v in state.items()}
    return Measured(
        track.name, frame, axes, t, means, turned, target, design, nuisance,
        noise, ((t - t[0]) / _CORRELATED_S).astype(np.int64),
    )  # fmt: skip


def _channels(
    problem: FlightProblem, flight: int, quantity: str
) -> tuple[str, list[int], tuple[int, ...]] | None:
    """Return group, places of the channels in it, and their axes."""
    for group, names in problem.channels[flight].items():
        chosen = [
            k for k, c in enumerate(names) if c.name.rsplit(" ", 1)[0] in _CHANNELS[quantity]
        ]
        if chosen:
            return group, chosen, tuple("xyz".index(names[k].name[-1]) for k in chosen)
    return None


def _inertia(vehicle: object) -> Array:
    return np.array([getattr(vehicle, f"inertia_{axis}") for axis in ("xx", "yy", "zz")])


def _unknowns(problem: FlightProblem, fit: Fit) -> Array:
    """Return what is free as fitted and all else as nominal, about the fit's theta."""
    unknowns = fit.prior_mean.copy()
    places = problem.columns.places((*fit.free, *problem.columns.absorbed))
    unknowns[places] = fit.solution.mean[places]
    return unknowns


def _state(problem: FlightProblem, fit: Fit, flight: int) -> dict[str, Array]:
    """Return the variables of the terms at the ticks of a flight."""
    track, motion = problem.tracks[flight], tangent_of(fit).linears[flight].motion
    values = motion.state
    body = np.einsum("nji,nj->ni", motion.rotation, values[:, 3:6])
    state = dict(zip(("x", "y", "z", "vx", "vy", "vz"), values[:, :6].T, strict=True))
    state |= dict(zip("uvw", body.T, strict=True))
    state |= dict(zip("pqr", values[:, 10:13].T, strict=True))
    state["yaw"] = yaw_pitch_roll(values[:, 6:10])[:, 0]
    state["t"] = track.t - track.t[0]
    state["thrust"] = _thrust(problem, fit, flight, motion)
    if track.voltage.size:
        state["voltage"] = track.voltage[:, 0]
    return state


def _thrust(problem: FlightProblem, fit: Fit, flight: int, motion: MotionOfPoses) -> Array:
    """Return the thrust of all rotors as the model has it [N]; drag along the axis is small."""
    out = simulate_along_motion(problem.tracks[flight], problem.nominal, fit.theta, motion)
    return np.asarray(problem.nominal.vehicle.mass * out["force"][:, 2])

"""Synthetic stand cases: nothing hidden, one effect, two, or a shape that no effect describes.

The stands are richer than the candidates. Every parameter is off by the tolerance of a careful
lab. Noise has heavy tails and is not quite the stated one. Propellers and tares scatter. The law
is any of two. All of it derives from (seed, number of the case).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tombo_benchmarks.diagnosis.cases import (
    KINDS,
    UNKNOWN_SIZES,
    Case,
    draw_factor,
    draw_hidden,
    draw_name,
    draw_size,
)
from tombo_benchmarks.diagnosis.unmodelled_effects import UNMODELLED_EFFECTS
from tombo_diagnosis.engine.regression import FreeParameter
from tombo_diagnosis.stand.problem import parameters
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import configuration, parameter_row, speed_of_maximum_thrust
from tombo_dynamics.propeller.effects import STAND_EFFECTS, Draws, Setup, predict

STANDS = (("full", 0.4), ("beta", 0.2), ("torque", 0.2), ("thrust", 0.2))
"""full: thrust, torque, flap angle, a second tachometer, known loads, three nodi; beta: thrust,
torque, angle; torque: thrust and torque; thrust: thrust alone, one nodus."""
_BLIND_TO: Mapping[str, tuple[str, ...]] = {
    "thrust": ("torque_", "drag_", "angle_"), "torque": ("angle_",), "beta": (), "full": (),
}  # fmt: skip
"""Effects that a stand without the instrument can't show, by the beginning of their names."""
_TORQUE_SHAPES = ("hub_friction", "creep")


@dataclass(frozen=True)
class StandCase(Case):
    """A stand with something hidden; its formulation is one of STANDS."""

    points: OperatingPoints


def make_case(seed: int, number: int) -> StandCase:
    """Return a case; the same for the same seed and number."""
    rng = np.random.default_rng([seed, number, 7])
    kind, stand = draw_name(rng, KINDS), draw_name(rng, STANDS)
    setup, names = _setup(rng, stand)
    every = parameters(setup)
    theta = {p.label: p.null + _healthy(p, rng) for p in every}
    size = draw_size(rng, kind)
    shift: dict[str, float] = {}
    can = [n for n in shown(stand, setup) if n in {p.effect for p in every}]
    hidden = tuple(draw_hidden(rng, kind, can))
    for name in hidden:
        factor = draw_factor(rng, size)
        for p in every:
            if p.effect == name:
                value = _moved(p, theta[p.label], factor, name, rng)
                theta[p.label], shift[p.label] = value, value - p.null
    values = {n: tuple(theta[p.label] for p in every if p.effect == n) for n in STAND_EFFECTS}
    values = {n: v for n, v in values.items() if v}
    draws = Draws(
        _spread(rng, (setup.propeller.max() + 1, 2)),
        _spread(rng, (setup.run.max() + 1, 2)),
        rng.standard_normal(setup.speed.size),
        _spread(np.random.default_rng([seed, number, 8]), (setup.run.max() + 1, 2)),
    )
    clean = predict(setup, values, draws)
    if kind == "unknown":
        can = [n for n in UNMODELLED_EFFECTS if stand != "thrust" or n not in _TORQUE_SHAPES]
        hidden = (str(rng.choice(can)),)
        shaped = UNMODELLED_EFFECTS[hidden[0]](clean, setup, UNKNOWN_SIZES[size], rng)
        clean = np.where((setup.speed > 0.0)[:, None], shaped, clean)
    points = _read(clean, setup, stand, names, rng)
    return StandCase(number, kind, size, stand, hidden, shift, points)


def shown(stand: str, setup: Setup) -> list[str]:
    """Return the effects that a stand can show at all."""
    one = int(setup.propeller.max()) < 2
    few = int(setup.run.max()) < 2
    return [
        n for n, e in STAND_EFFECTS.items()
        if e.suits("tombo") and not n.startswith(_BLIND_TO[stand])
        and not (n == "fabrication_scatter" and one) and not (n == "tare_scatter" and few)
        and n != "run_scatter"  # every stand has it, by as much as a healthy one
    ]  # fmt: skip


def _setup(rng: np.random.Generator, stand: str) -> tuple[Setup, tuple[tuple[str, ...], ...]]:
    soft, middle, stiff = (1, 5, 6, 7), (8, 9, 10), (2, 3, 11, 12, 13)
    groups = [int(rng.choice(g)) for g in (soft, middle, stiff)]
    confs = groups if stand != "thrust" else [int(rng.choice(groups))]
    if stand in ("full", "beta"):
        confs = [*confs, int(rng.choice((*middle, *stiff)))]
    law = str(rng.choice(["repaired", "repaired", "consistent"]))
    steps = int(rng.integers(9, 15))
    parts = []
    run = 0
    for k, number in enumerate(confs):
        top = speed_of_maximum_thrust(configuration(number), "repaired")[0]
        highest = min(top, 1150.0) * float(rng.uniform(0.6, 0.75))
        row = parameter_row(configuration(number), law)
        for _ in range(2 if len(confs) > 1 else 3):
            up: Array = np.linspace(0.25, 1.0, steps, dtype=np.float64) * highest
            down = up[-2::-1] if rng.random() < 0.7 else up[:0]
            way: Array = np.concatenate([up, down])
            way = way * rng.uniform(0.99, 1.01, way.size)
            loads: Array = np.zeros(0)
            if stand == "full":
                loads = np.array([0.0, 0.5, 1.0])
                way = np.concatenate([np.zeros(3), way])
            parts.append((way, k, run, row, loads))
            run += 1
    n = [w.size for w, *_ in parts]
    rows = np.concatenate(
        [np.tile(r, (m, 1)) for (_, _, _, r, _), m in zip(parts, n, strict=True)]
    )
    speed = np.concatenate([w for w, *_ in parts])
    nominal = Setup(
        speed, rows,
        np.repeat([k for _, k, _, _, _ in parts], n), np.repeat([r for _, _, r, _, _ in parts], n),
        np.concatenate([np.linspace(0.0, 1.0, m) for m in n]), law,
    )  # fmt: skip
    base = predict(nominal, {})
    largest = float(np.nanmax(base[:, 0])), float(np.nanmax(base[:, 1]))
    hung = np.concatenate(
        [np.append(p[4], np.zeros(m - p[4].size)) for p, m in zip(parts, n, strict=True)]
    )
    setup = Setup(
        speed, rows, nominal.propeller, nominal.run, nominal.elapsed, law,
        applied_thrust=hung * largest[0], applied_torque=hung * largest[1],
        largest_thrust=largest[0], largest_torque=largest[1],
    )  # fmt: skip
    return setup, (
        tuple(f"run {k + 1}" for k in range(run)),
        tuple(f"propeller {k + 1}, Conf. {c}" for k, c in enumerate(confs)),
    )


def _read(
    clean: Array,
    setup: Setup,
    stand: str,
    names: tuple[tuple[str, ...], ...],
    rng: np.random.Generator,
) -> OperatingPoints:
    """Add noise with heavy tails, and leave out what the stand has not."""
    said = np.array([
        rng.uniform(0.002, 0.005) * setup.largest_thrust,
        rng.uniform(0.004, 0.010) * setup.largest_torque,
        np.radians(rng.uniform(0.25, 0.5)),
        rng.uniform(0.0005, 0.001) * float(setup.speed.max()),
    ])  # fmt: skip
    sigma = np.tile(said, (clean.shape[0], 1))
    true = sigma * rng.uniform(0.85, 1.15, (1, 4))
    noise = rng.standard_t(8, clean.shape) / np.sqrt(8.0 / 6.0)
    readings = clean + true * noise
    have = {"thrust": 1, "torque": 2, "beta": 3, "full": 4}[stand]
    readings[:, have:] = np.nan
    readings[setup.speed == 0.0, 2:] = np.nan
    return OperatingPoints(setup, readings, sigma, *names)


def _healthy(p: FreeParameter, rng: np.random.Generator) -> float:
    """Return how far a parameter is off its null on a healthy stand."""
    if p.stochastic:
        return p.tolerance
    off = p.tolerance * float(rng.standard_normal())
    return abs(off) if p.null <= p.low else off


def _moved(
    p: FreeParameter, base: float, factor: float, name: str, rng: np.random.Generator
) -> float:
    """Return a parameter's hidden value: `factor` of what matters from its null, either way."""
    if p.stochastic or p.null <= p.low:
        return float(min(p.null + factor * p.scale + (base - p.null) * (not p.stochastic), p.high))
    side = -1.0 if rng.random() < 0.5 else 1.0
    if name == "torsion_constant":
        factor = 1.0 - min(factor * p.scale, 0.9)  # as much stiffer as softer, on a logarithm
        return (factor if side < 0.0 else 1.0 / factor) + base - 1.0
    return float(np.clip(base + side * factor * p.scale, p.low, p.high))


def _spread(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Draw with a spread near one: otherwise a few draws could all be small."""
    drawn = rng.standard_normal(shape)
    return np.asarray(drawn * np.maximum(1.0, 0.8 / np.sqrt(np.mean(drawn**2, axis=0))))

"""Synthetic flight cases: nothing hidden, one effect, two, or a force that no effect describes.

The flights come from a richer model than the candidates: every parameter is off its nominal value
by what a careful lab leaves (the tolerance), sensors have faults that no effect has, and courses
differ. All of it derives from (seed, number of the case).
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
from tombo_benchmarks.diagnosis.disturbances import DISTURBANCES
from tombo_diagnosis.engine.regression import FreeParameter
from tombo_diagnosis.flight.nominal import PARAMETERS, nominal_model
from tombo_dynamics.effects import REGISTRY

FORMULATIONS = (("imu_rpm", 0.35), ("imu", 0.25), ("mocap_rpm", 0.2), ("mocap", 0.2))
EXCLUDED_EFFECTS = frozenset(
    n for n, effect in REGISTRY.items() if effect.contact or effect.company or effect.vibration
)
"""Effects of contact and of other vehicles, because the flights of the benchmark have none, and
vibration, which no model of the motion shows."""
UNOBSERVABLE_PARAMETERS = frozenset({"mocap_misalignment.yaw"})
"""No flight can show it: physics does not know where north is."""
_SWINGS = frozenset(
    f"steady_wind.{n}" for n in ("swing_east", "swing_north", "frequency", "phase")
)
"""Wind is hidden without a swing."""
_ALIASES = frozenset({"body_push"})
"""Shapes that without an IMU are the same as an effect: a constant push in body axes is a thrust
that leans, as of a rigid body that was defined turned."""
_NOISES = (
    *("imu_noise.gyro", "imu_noise.accel", "mocap_noise.position", "mocap_noise.attitude"),
    *("mocap_latency.jitter", "thrust_scatter.deviation"),
)
"""Hidden as more of it: nobody looks for the cause of too little noise."""
_IMU_ONLY = ("imu_", "accel_scale")
"""Effects that only an IMU shows."""
_LARGEST_STAMP_ERROR = 0.009
"""s: later than it arrives no stamp can be."""
COURSE_S = 20.0
"""s: length of a random course."""
NOMINAL_MODEL = nominal_model()
"""What `tombo diagnose` compares flights with."""
NOMINAL = {n: e for n, e in NOMINAL_MODEL.effects.items() if n not in EXCLUDED_EFFECTS}
"""Effects that it knows, without contact."""

Effects = dict[str, dict[str, float]]


@dataclass(frozen=True)
class FlightCase(Case):
    """A vehicle with something hidden; its formulation is imu or mocap, _rpm with rotor speeds."""

    effects: Mapping[str, Mapping[str, float]]
    """The true model: nominal, off by tolerances, and hidden."""
    disturbance: tuple[float, ...]
    """Parameters of the disturbance, empty for none."""
    flights: int
    seed: tuple[int, int]
    course_s: float = COURSE_S
    """Approximate length of each course [s], with hover and turns coming on top."""


def make_case(seed: int, number: int, flights: int = 3, course_s: float = COURSE_S) -> FlightCase:
    """Return a case; the same for the same seed and number, whatever its flights."""
    rng = np.random.default_rng([seed, number])
    kind = draw_name(rng, KINDS)
    formulation = draw_name(rng, FORMULATIONS)
    effects: Effects = {name: dict(values) for name, values in NOMINAL.items()}
    _perturb_within_tolerances(effects, rng)
    shift: dict[str, float] = {}
    size = draw_size(rng, kind)
    disturbance: tuple[float, ...] = ()
    hidden = draw_hidden(rng, kind, observable_effects(formulation))
    for name in hidden:
        for p, change in _shift(name, draw_factor(rng, size), rng).items():
            base = effects.setdefault(name, {}).get(p.name, p.null)
            value = float(np.clip(base + change, p.low, p.high))
            if p.label == "mocap_stamp_error.offset" and value > _LARGEST_STAMP_ERROR:
                value = -value
            effects[name][p.name] = value
            shift[p.label] = value - nominal_value(p)
    if kind == "unknown":
        aliased = _ALIASES if formulation.startswith("mocap") else ()
        hidden = [str(rng.choice([s for s in DISTURBANCES if s not in aliased]))]
        disturbance = _disturbance(hidden[0], UNKNOWN_SIZES[size], rng)
    return FlightCase(
        number, kind, size, formulation, tuple(hidden), shift, effects, disturbance, flights,
        (seed, number), course_s=course_s,
    )  # fmt: skip


def observable_effects(formulation: str) -> list[str]:
    """Return the effects that flights with these sensors can show at all."""
    names = list(dict.fromkeys(p.effect for p in PARAMETERS))
    blind: tuple[str, ...] = _IMU_ONLY if formulation.startswith("mocap") else ()
    return [n for n in names if n not in EXCLUDED_EFFECTS and not n.startswith(blind)]


def nominal_value(parameter: FreeParameter) -> float:
    """Return a parameter's value in the nominal model."""
    return NOMINAL.get(parameter.effect, {}).get(parameter.name, parameter.null)


def _perturb_within_tolerances(effects: Effects, rng: np.random.Generator) -> None:
    """Put every parameter off its nominal value by the spread between healthy vehicles."""
    for p in PARAMETERS:
        off = p.tolerance * float(rng.standard_normal())
        if not off:
            continue
        base = nominal_value(p)
        if base <= p.low:
            off = abs(off)
        effects.setdefault(p.effect, {})[p.name] = float(np.clip(base + off, p.low, p.high))


def _shift(name: str, factor: float, rng: np.random.Generator) -> dict[FreeParameter, float]:
    """Return how far the hidden effect's parameters are moved: `factor` of what matters."""
    own = [
        p
        for p in PARAMETERS
        if p.effect == name and p.label not in UNOBSERVABLE_PARAMETERS | _SWINGS
    ]
    if name == "gusts":
        deviation, time = own
        return {deviation: factor * deviation.scale, time: float(rng.uniform(-0.5, 1.0))}
    if name == "mocap_dropouts":
        probability, duration = own
        return {probability: factor * probability.scale, duration: duration.scale}
    if name == "hanging_load":
        return {own[0]: factor * own[0].scale}
    if name in ("weak_propeller", "mocap_latency"):
        chosen = [own[int(rng.integers(len(own)))]]
    else:
        unit = str(rng.choice(sorted({p.unit for p in own})))
        chosen = [p for p in own if p.unit == unit]
    direction = rng.standard_normal(len(chosen))
    direction /= np.linalg.norm(direction)
    moved = {}
    for p, share in zip(chosen, direction, strict=True):
        change = factor * p.scale * float(share)
        if p.label in _NOISES:
            change = abs(change)
        base = nominal_value(p)
        if not p.low <= base + change <= p.high:
            change = -change
        moved[p] = change
    return moved


def _disturbance(name: str, factor: float, rng: np.random.Generator) -> tuple[float, ...]:
    """Return the parameters of a disturbance whose strength is `factor` times its typical one."""
    kind = DISTURBANCES[name]
    values = []
    for parameter, value in kind.typical.items():
        if parameter in kind.strength:
            value *= factor
        elif parameter == "heading":
            value = float(rng.uniform(-np.pi, np.pi))
        elif parameter == "frequency":
            value = float(rng.uniform(0.15, 1.5))
        values.append(value)
    return tuple(values)

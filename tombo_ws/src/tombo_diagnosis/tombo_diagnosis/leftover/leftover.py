"""A leftover force or moment: its samples, the terms that it is made of, and their effect.

The effect is source text, ready to be pasted into the registry.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.leftover.sparse_fit import (
    Rows,
    SparseFit,
    interval_of,
    sparse_fit,
    without_tolerances,
)
from tombo_diagnosis.leftover.terms import FUNCTIONS, Term, named
from tombo_dynamics.arrays import Array

NAME: Final = "leftover"
"""Of the effect."""
_AXES: Final = "xyz"
_STATE: Final = {
    ("x", "y", "z"): "plant.state.position",
    ("vx", "vy", "vz"): "plant.state.velocity",
    ("p", "q", "r"): "plant.state.rates",
    ("u", "v", "w"): "plant.airspeed",
    ("yaw",): "atan2(plant.rotation[1, 0], plant.rotation[0, 0])",
    ("thrust",): "plant.rotors[0].thrust",
    ("t",): "plant.ticks * plant.tick_length",
    ("voltage",): "plant.supply.voltage",
}
"""Variables of the terms → where an effect finds them."""


@dataclass(frozen=True)
class Contribution:
    """A term with its coefficient, as part of the force or of the moment."""

    quantity: str
    """force or moment."""
    term: Term
    value: float


def effect_text(parts: Sequence[Contribution]) -> str:
    """Return the module of an effect that adds these terms; empty without any.

    Its parameters are null where nothing is added, and typical as fitted.
    """
    if not parts:
        return ""
    names = [_identifier(part) for part in parts]
    params = [_param(name, part) for name, part in zip(names, parts, strict=True)]
    body = [*_variables(parts)]
    for quantity in dict.fromkeys(part.quantity for part in parts):
        body += _sums(quantity, [(n, p) for n, p in zip(names, parts, strict=True)
                                 if p.quantity == quantity])  # fmt: skip
    text = "\n".join(f"    {line}" for line in body)
    used = [f for f in ("atan2", *FUNCTIONS) if re.search(rf"\b{f}\(", text)]
    maths = f"from math import {', '.join(used)}\n\n" if used else ""
    turned = "from tombo_dynamics.rotation import to_body\n" if "to_body(" in text else ""
    arguments = "".join(f",\n    {name}: float" for name in names)
    signature = "; ".join(f"{p.quantity}: {p.term.name}" for p in parts)
    lines = textwrap.wrap(signature, 80, drop_whitespace=False)
    quoted = "\n    ".join(f'"{line}"' for line in lines)
    return (
        f'"""A force that diagnosed flights left over, as a sum of terms."""\n\n'
        f"{maths}from tombo_dynamics.arrays import Array\n"
        "from tombo_dynamics.effects.registry import Param, Stage, effect\n"
        f"from tombo_dynamics.plant import Plant\n{turned}\n\n"
        f'@effect(\n    "{NAME}",\n    Stage.WRENCH,\n    [\n'
        + "".join(f"        {line},\n" for line in params)
        + f"    ],\n    signature={quoted},\n)\n"
        f"def {NAME}(\n    plant: Plant,\n    noise: Array{arguments},\n) -> None:\n"
        f'    """Add what was fitted to flights; an exact cause is still to be found."""\n{text}\n'
    )


def _identifier(part: Contribution) -> str:
    return re.sub(r"\W+", "_", f"{part.quantity} {part.term.name}".removeprefix("force ")).lower()


def _param(name: str, part: Contribution) -> str:
    size = 10.0 ** math.ceil(math.log10(10.0 * max(abs(part.value), 1e-9)))
    unit = part.term.unit
    return (
        f'Param("{name}", "{unit}", 0.0, ({-size:g}, {size:g}), "{part.term.name}", '
        f"{part.value:.4g})"
    )


def _variables(parts: Sequence[Contribution]) -> list[str]:
    needed = {name for part in parts for name in part.term.variables}
    lines = []
    for names, source in _STATE.items():
        for i, name in enumerate(names):
            if name in needed:
                lines.append(f"{name} = {source}{f'[{i}]' if len(names) == 3 else ''}")
    return lines


def _sums(quantity: str, parts: Sequence[tuple[str, Contribution]]) -> list[str]:
    """Return the lines that add terms to one quantity of the plant."""
    lines = []
    for frame in ("map", "body"):
        in_frame = [(name, part.term) for name, part in parts if part.term.frame == frame]
        if not in_frame:
            continue
        added = [
            (i, name if text == "1.0" else f"{name} * ({text})")
            for name, term in in_frame
            for i, text in enumerate(term.components)
            if text != "0.0"
        ]
        if frame == "body":
            lines += [f"plant.{quantity}[{i}] += {text}" for i, text in added]
            continue
        lines.append("map_x = map_y = map_z = 0.0")
        lines += [f"map_{_AXES[i]} += {text}" for i, text in added]
        lines.append("bx, by, bz = to_body(plant.rotation, (map_x, map_y, map_z))")
        lines += [f"plant.{quantity}[{i}] += b{a}" for i, a in enumerate(_AXES)]
    return lines


UNITS: Mapping[str, str] = {"force": "N", "moment": "N m"}
"""Quantity → unit."""
SPRINGS: Mapping[str, str] = {
    "spring to a vertical line": "xy", "spring to a point": "xyz",
    "spring along x": "x", "spring along y": "y", "spring along z": "z",
}  # fmt: skip
"""Terms that pull to a place → the coordinates of it that they fix."""


@dataclass(frozen=True)
class Measured:
    """What one flight measured of a force [N] or a moment [N m], means of short blocks of time.

    M blocks, A axes, K terms, U unknown parameters of the nominal model.
    """

    flight: str
    frame: str
    """Axes of target, design and nuisance: map or body."""
    axes: tuple[int, ...]
    """(A) which of x, y, z were measured."""
    t: Array
    """(M,) since the start of the flight [s]."""
    state: Mapping[str, Array]
    """Variable of the terms → (M,)."""
    rotation: Array
    """(M, 3, 3) map from body."""
    target: Array
    """(M, A) measured minus model."""
    design: Array
    """(M, A, K) terms with a coefficient of one."""
    nuisance: Array
    """(M, A, U) what one tolerance of each parameter changes."""
    deviation: Array
    """(A) of the noise of a block."""
    second: NDArray[np.int64]
    """(M,) blocks of the same number are correlated."""


@dataclass(frozen=True)
class FittedTerm:
    """A term of the leftover."""

    quantity: str
    """force or moment."""
    name: str
    formula: str
    """The vector that the coefficient multiplies."""
    unit: str
    value: float
    low: float
    """95 % interval."""
    high: float
    remark: str = ""
    """Of a spring: where it is slack."""


@dataclass(frozen=True)
class LeftoverSamples:
    """One flight's leftover, to be drawn; without what tolerances explain."""

    flight: str
    quantity: str
    t: Array
    """(M,) since the start of the flight [s]."""
    state: Mapping[str, Array]
    rotation: Array
    """(M, 3, 3) map from body."""
    body: Array
    """(M, 3) body axes; NaN along an axis that was not measured."""
    fitted: Array
    """(M, 3) what the terms give there, body axes; zeros without any."""

    def in_map(self, values: Array) -> Array:
        """Return vectors (M, 3) of body axes in map."""
        return np.asarray(np.einsum("nij,nj->ni", self.rotation, np.nan_to_num(values)))


@dataclass(frozen=True)
class Leftover:
    """What the causes named do not explain."""

    terms: tuple[FittedTerm, ...]
    """Empty: nothing of the dictionary predicts it in flights held out."""
    r2: Mapping[str, float]
    """Quantity → share of the leftover that terms fitted to other flights predict."""
    rms: Mapping[str, float]
    """Quantity → root mean square of the vector."""
    effect: str
    """Source of an effect with these terms; empty without any."""
    samples: tuple[LeftoverSamples, ...]


def leftover_of(
    measured: Mapping[str, Sequence[Measured]], dictionaries: Mapping[str, Sequence[Term]]
) -> Leftover:
    """Return the leftover of flights with its sparse fit.

    Args:
        measured: quantity → the flights.
        dictionaries: quantity → its terms, in the order of the designs.
    """
    fits = {q: _fit(flights, dictionaries[q]) for q, flights in measured.items()}
    samples = [
        _samples(q, flight, fits[q]) for q, flights in measured.items() for flight in flights
    ]
    parts = [
        Contribution(q, dictionaries[q][k], float(value))
        for q, fit in fits.items()
        for k, value in zip(fit.chosen, fit.value, strict=True)
    ]
    return Leftover(
        tuple(term for q, fit in fits.items() for term in _terms(q, fit, dictionaries[q])),
        {q: fit.r2 for q, fit in fits.items()},
        {q: _rms([s.body for s in samples if s.quantity == q]) for q in fits},
        effect_text(parts),
        tuple(samples),
    )


def _fit(flights: Sequence[Measured], terms: Sequence[Term]) -> SparseFit:
    places = named(terms)
    partners = [tuple(places[name] for name in term.partners) for term in terms]
    return sparse_fit([_rows(flight) for flight in flights], partners)


def _rows(flight: Measured) -> Rows:
    """Return a flight's equations with unit noise, a row for each block and axis."""
    count, axes, terms = flight.design.shape
    weight = 1.0 / flight.deviation[:, None]
    design = (flight.design * weight).reshape(count * axes, terms)
    nuisance = (flight.nuisance * weight).reshape(count * axes, -1)
    target = (flight.target * weight[:, 0]).reshape(-1)
    free = without_tolerances(design, target, nuisance)
    return Rows(*free, np.repeat(flight.second, axes))


def _samples(quantity: str, flight: Measured, fit: SparseFit) -> LeftoverSamples:
    """Return a flight's leftover without the part that tolerances most probably have."""
    fitted = flight.design[:, :, list(fit.chosen)] @ fit.value
    weight = 1.0 / flight.deviation[:, None]
    count, axes, unknowns = flight.nuisance.shape
    nuisance = (flight.nuisance * weight).reshape(count * axes, unknowns)
    rest = ((flight.target - fitted) * weight[:, 0]).reshape(-1)
    known = np.eye(unknowns) + nuisance.T @ nuisance
    off = np.linalg.solve(known, nuisance.T @ rest)
    left = flight.target - flight.nuisance @ off

    def in_body(values: Array) -> Array:
        full = np.full((count, 3), np.nan)
        full[:, list(flight.axes)] = values
        return full if flight.frame == "body" else np.einsum("nji,nj->ni", flight.rotation, full)

    return LeftoverSamples(
        flight.flight,
        quantity,
        flight.t,
        flight.state,
        flight.rotation,
        in_body(left),
        in_body(fitted),
    )


def _rms(values: Sequence[Array]) -> float:
    every = np.vstack(values)
    known = np.isfinite(every).any(axis=0)  # an axis may not be compared at all
    return float(np.sqrt(np.nanmean(every[:, known] ** 2, axis=0).sum()))


def _terms(quantity: str, fit: SparseFit, terms: Sequence[Term]) -> list[FittedTerm]:
    fitted = []
    value = {terms[k].name: float(v) for k, v in zip(fit.chosen, fit.value, strict=True)}
    for k, middle, low, high in zip(fit.chosen, fit.value, *interval_of(fit), strict=True):
        term = terms[k]
        fitted.append(
            FittedTerm(
                quantity, term.name, term.formula, term.unit, float(middle), float(low),
                float(high), _slack(term.name, value),
            )
        )  # fmt: skip
    return fitted


def _slack(name: str, value: Mapping[str, float]) -> str:
    """Return where a spring is slack; what pushes away from a place has none."""
    if name not in SPRINGS or not value[name] < 0.0:
        return ""
    at = {a: -value[f"constant in map {a}"] / value[name] for a in SPRINGS[name]}
    return "pulls to " + ", ".join(f"{a} {place:.2f} m" for a, place in at.items())

"""The fixed dictionary of physical terms that a leftover force or moment is made of.

A term is a vector in map or body axes; each component is one expression. The same text is
evaluated over measured flights and written into the effect, so both are one formula.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import CodeType
from typing import Final

import numpy as np

from tombo_dynamics.arrays import Array

FUNCTIONS: Final = ("cos", "exp", "fabs", "sin", "sqrt")
"""What an expression may call; of `math` and of numpy alike."""
_DECAY_M: Final = 0.5
_HEADINGS: Final = 12
"""Of walls: one is at most 15 deg off."""
_AXES: Final = "xyz"


@dataclass(frozen=True)
class Extent:
    """The part of the state that the flights cover: it fixes the terms' reference points."""

    places: Array
    """(N, 2) x and y in map [m]."""
    voltage: float
    """Mean [V]; NaN: not measured."""


@dataclass(frozen=True)
class Term:
    """A force [N] or moment [N m] for a coefficient of one."""

    name: str
    frame: str
    """map or body."""
    components: tuple[str, str, str]
    """Expressions of place x, y, z and velocity vx, vy, vz in map; velocity u, v, w and rates p,
    q, r in body; yaw; thrust [N]; time t since the start [s]; voltage [V]."""
    unit: str
    """Of the coefficient."""
    partners: tuple[str, ...] = ()
    """Terms that are fitted with it: a spring needs the place where it is slack."""

    @property
    def formula(self) -> str:
        """The vector as text."""
        return f"({', '.join(self.components)}) in {self.frame}"

    @cached_property
    def _codes(self) -> tuple[CodeType, ...]:
        return tuple(compile(text, self.name, "eval") for text in self.components)

    @property
    def variables(self) -> frozenset[str]:
        """Names of the state that it takes."""
        return frozenset(n for code in self._codes for n in code.co_names) - {*FUNCTIONS}

    def values(self, state: Mapping[str, Array], rotation: Array) -> Array:
        """Return the term (N, 3) in body axes, for (N,) of each variable.

        `rotation`: (N, 3, 3) map from body.
        """
        # Only texts of the table below are evaluated, with nothing but these names.
        names = {name: getattr(np, name) for name in FUNCTIONS} | dict(state)
        count = rotation.shape[0]
        vectors = np.column_stack(
            [
                np.broadcast_to(np.asarray(eval(code, {"__builtins__": {}}, names)), (count,))
                for code in self._codes
            ]
        ).astype(np.float64)
        return vectors if self.frame == "body" else np.einsum("nji,nj->ni", rotation, vectors)


def force_terms(extent: Extent) -> tuple[Term, ...]:
    """Return the dictionary for forces; without a voltage, without its term."""
    constant = {a: f"constant in map {a}" for a in _AXES}
    terms = [_along(constant[a], "map", a, "1.0", "N") for a in _AXES]
    terms += [_along(f"constant in body {a}", "body", a, "1.0", "N") for a in _AXES]
    terms += _drags()
    for a in _AXES:
        terms.append(_along(f"velocity in map {a}", "map", a, f"v{a}", "N s/m"))
        square = f"v{a} * fabs(v{a})"
        terms.append(_along(f"square of velocity in map {a}", "map", a, square, "N s^2/m^2"))
    level = (constant["x"], constant["y"])
    terms += [
        Term("spring to a vertical line", "map", ("x", "y", "0.0"), "N/m", level),
        Term("spring to a point", "map", ("x", "y", "z"), "N/m", tuple(constant.values())),
    ]
    for a in _AXES:
        spring = f"spring along {a}"
        terms.append(_along(spring, "map", a, a, "N/m", constant[a]))
        terms += [
            _along(f"force {a} with place {b}", "map", a, b, "N/m", constant[a])
            for b in _AXES
            if b != a
        ]
    terms += [
        _along("height, exponential", "map", "z", f"exp(-z / {_DECAY_M})", "N"),
        _along("height, inverse", "map", "z", "1.0 / (0.2 + fabs(z))", "N m"),
        _along("thrust near the ground", "body", "z", f"thrust * exp(-z / {_DECAY_M})", "1"),
    ]
    terms += [_wall(k, extent) for k in range(_HEADINGS)]
    terms += [_along(f"time in map {a}", "map", a, "t", "N/s", constant[a]) for a in _AXES]
    terms += [_along(f"share of thrust, body {a}", "body", a, "thrust", "1") for a in _AXES]
    terms += [
        _along("thrust with time", "body", "z", "thrust * t", "1/s"),
        _along("square of thrust", "body", "z", "thrust * thrust", "1/N"),
        Term("thrust times velocity", "body", ("thrust * u", "thrust * v", "0.0"), "s/m"),
        _along("thrust times climb", "body", "z", "thrust * w", "s/m"),
        _along("pitch rate", "body", "x", "q", "N s"),
        _along("roll rate", "body", "y", "p", "N s"),
    ]
    if math.isfinite(extent.voltage):
        expression = f"thrust * (voltage - {extent.voltage:.1f})"
        terms.append(_along("thrust with voltage", "body", "z", expression, "1/V"))
    return tuple(terms)


def moment_terms() -> tuple[Term, ...]:
    """Return the dictionary for moments."""
    terms = [_along(f"constant in body {a}", "body", a, "1.0", "N m") for a in _AXES]
    terms += [_along(f"constant in map {a}", "map", a, "1.0", "N m") for a in "xy"]
    terms += [
        _along("sine of yaw", "body", "z", "sin(yaw)", "N m"),
        _along("cosine of yaw", "body", "z", "cos(yaw)", "N m"),
        Term("velocity, as of flapping", "body", ("v", "-u", "0.0"), "N s"),
        _along("yaw moment with velocity x", "body", "z", "u", "N s"),
        _along("yaw moment with velocity y", "body", "z", "v", "N s"),
        _along("yaw moment with place x", "body", "z", "x", "N"),
        _along("yaw moment with place y", "body", "z", "y", "N"),
    ]
    for a, rate in zip(_AXES, "pqr", strict=True):
        terms += [
            _along(f"damping about {a}", "body", a, rate, "N m s"),
            _along(f"share of thrust about {a}", "body", a, "thrust", "m"),
            _along(f"time about {a}", "body", a, "t", "N m/s", f"constant in body {a}"),
        ]
    return tuple(terms)


def _along(name: str, frame: str, axis: str, expression: str, unit: str, *partners: str) -> Term:
    x, y, z = (expression if a == axis else "0.0" for a in _AXES)
    return Term(name, frame, (x, y, z), unit, partners)


def _drags() -> list[Term]:
    speed, level = "sqrt(u * u + v * v + w * w)", "sqrt(u * u + v * v + 0.0025)"
    return [
        Term("linear drag in the disc plane", "body", ("u", "v", "0.0"), "N s/m"),
        _along("linear drag along the axis", "body", "z", "w", "N s/m"),
        Term(
            "quadratic drag", "body", (f"u * {speed}", f"v * {speed}", f"w * {speed}"), "N s^2/m^2"
        ),
        Term("dry drag in the disc plane", "body", (f"u / {level}", f"v / {level}", "0.0"), "N"),
    ]


def _wall(k: int, extent: Extent) -> Term:
    """Return a force normal to a wall; the coefficient acts where flights came nearest to it."""
    heading = 2.0 * math.pi * k / _HEADINGS
    c, s = (round(f(heading), 4) + 0.0 for f in (math.cos, math.sin))
    edge = float((extent.places @ (c, s)).max())
    near = f"exp(({c} * x + {s} * y - {edge:.2f}) / {_DECAY_M})"
    x, y = (f"{share} * {near}" if share else "0.0" for share in (c, s))
    degrees = round(math.degrees(heading))
    return Term(f"wall at a heading of {degrees} deg", "map", (x, y, "0.0"), "N")


def named(terms: Sequence[Term]) -> dict[str, int]:
    """Return name -> place in the dictionary."""
    return {term.name: k for k, term in enumerate(terms)}

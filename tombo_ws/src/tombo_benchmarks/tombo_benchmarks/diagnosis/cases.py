"""Synthetic cases: nothing is hidden, one effect, two, or one that the registry lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

SIZES = {"small": 0.25, "medium": 0.5, "large": 1.0}
"""Share of the size that clearly matters (`typical` in the registry)."""
UNKNOWN_SIZES = {"small": 0.8, "medium": 1.2, "large": 2.0}
"""Strength of an unmodelled effect, over its typical one."""
KINDS = (("none", 0.2), ("single", 0.5), ("pair", 0.1), ("unknown", 0.2))


@dataclass(frozen=True)
class Case:
    """One synthetic case; all of it derives from (seed, number)."""

    number: int
    kind: str
    """none, single, pair or unknown."""
    size: str
    """small, medium, large; empty for none."""
    formulation: str
    """Which sensors there are."""
    hidden: tuple[str, ...]
    """Effects present beyond the nominal ones, of the registry or unmodelled."""
    shift: Mapping[str, float]
    """effect.parameter -> hidden value minus nominal value."""


def draw_name(rng: np.random.Generator, table: Sequence[tuple[str, float]]) -> str:
    """Return a name of a table (name, weight), drawn by the weights."""
    names, weights = zip(*table, strict=True)
    return str(rng.choice(names, p=np.array(weights) / sum(weights)))


def draw_hidden(rng: np.random.Generator, kind: str, effects: Sequence[str]) -> list[str]:
    """Return the effects that are hidden: one, two or none, drawn from `effects`."""
    count = {"single": 1, "pair": 2}.get(kind, 0)
    return [str(n) for n in rng.choice(effects, count, replace=False)] if count else []


def draw_factor(rng: np.random.Generator, size: str) -> float:
    """Return the share of the size that clearly matters, about that of small, medium or large."""
    return SIZES[size] * float(rng.uniform(0.8, 1.25))


def draw_size(rng: np.random.Generator, kind: str) -> str:
    """Return the size of the hidden cause; two causes are never small."""
    size = "" if kind == "none" else str(rng.choice(list(SIZES)))
    return "medium" if kind == "pair" and size == "small" else size

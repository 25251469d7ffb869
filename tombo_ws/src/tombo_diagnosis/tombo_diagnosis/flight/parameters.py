"""The parameters that a diagnosis frees: all of the registry, with what is taken for granted.

A lab knows its nominal parameters only so well. That is the *tolerance*: an error of this size is
no finding. A twentieth of the size that clearly matters is what careful weighing, balancing and
calibrating give; it is also what keeps a cause from being named for the small change of another.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.effects.compose import layout

Array = NDArray[np.float64]

TOLERANCE = 0.05
"""Share of the scale."""
WIDE = 1.0
"""What a candidate is given: a prior of so many scales, that is: of what clearly matters."""
_OWN_MASS, _OWN_ARM = 1.3, 0.24
"""kg and m: the vehicle that the registry's typical sizes are for."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of theta."""

    index: int
    effect: str
    name: str
    unit: str
    null: float
    low: float
    high: float
    scale: float
    """A change of this size clearly matters."""

    @property
    def label(self) -> str:
        """effect.name."""
        return f"{self.effect}.{self.name}"

    @property
    def tolerance(self) -> float:
        """Standard deviation of what counts as healthy."""
        return TOLERANCE * self.scale

    @property
    def step(self) -> float:
        """Step of a numerical derivative."""
        return 0.1 * self.scale


def parameters(mass: float = 1.3, arm: float = 0.24) -> tuple[Parameter, ...]:
    """Return all parameters of the registry, in the order of theta.

    What clearly matters is given for the suite's own vehicle: forces grow with the mass, lengths
    with the arm.

    Args:
        mass: of the vehicle [kg].
        arm: centre to rotor axis [m].
    """
    heavy, long = mass / _OWN_MASS, arm / _OWN_ARM
    sizes = {
        "N s/m": heavy,
        "m^2": heavy,
        "N m s/m": heavy * long,
        "m": long if long < 1.0 else 1.0,
    }
    found = []
    places = layout()
    for name, effect in REGISTRY.items():
        for p in effect.theta:
            alike = [abs(o.typical - o.null) for o in effect.theta if o.unit == p.unit]
            scale = abs(p.typical - p.null) or max(alike) or abs(p.typical) or 1.0
            place = places[name][p.name]
            if not name.startswith(("mocap_noise", "contact")):
                scale *= sizes.get(p.unit, 1.0)
            found.append(Parameter(place, name, p.name, p.unit, p.null, *p.bounds, scale))
    return tuple(sorted(found, key=lambda p: p.index))


PARAMETERS = parameters()


@lru_cache(maxsize=1024)
def variants(effect: str, seen: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return the ways in which an effect can be at work: one parameter, those of a unit, or all.

    Args:
        effect: its name.
        seen: places in theta of the parameters that the flights can show.
    """
    own = [p for p in PARAMETERS if p.effect == effect and p.index in seen]
    ways: list[tuple[int, ...]] = [(p.index,) for p in own]
    units = dict.fromkeys(p.unit for p in own)
    ways += [tuple(p.index for p in own if p.unit == unit) for unit in units]
    ways.append(tuple(p.index for p in own))
    return list(dict.fromkeys(way for way in ways if way))


def effects() -> list[str]:
    """Return the names of all effects of the registry."""
    return list(dict.fromkeys(p.effect for p in PARAMETERS))

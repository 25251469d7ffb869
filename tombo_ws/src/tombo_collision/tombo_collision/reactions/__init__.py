"""The reactions to a collision by name, one file each; a file in this folder is all it takes.

A reaction is a frozen dataclass of its parameters (`tombo_dynamics.params.param`: value, unit,
bounds, meaning) with a `name`, what it `needs`, and a method `decide`. Scenarios (`reaction:
{name: bounce}`), `--set reaction.distance=1`, `tombo reactions`, the node's parameters, the
documentation and the generic tests follow.
"""

from __future__ import annotations

import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import unknown_name
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import from_mapping

DEFAULT = "bounce"
REGISTRY: dict[str, type[Reaction]] = {}
"""Name -> reaction."""


@dataclass(frozen=True)
class Decision:
    """What a reaction decides on a collision. Positions and directions in map."""

    x_c: Array
    """(3) base_link at contact [m]."""
    n_r: Array
    """(3) unit vector, from x_c to x_r."""
    x_r: Array
    """(3) where to hold [m]."""


@dataclass(frozen=True)
class Reaction(ABC):
    """A reaction and its parameters. It decides from messages alone."""

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("mocap",)
    """What it lives on: "mocap", "imu", "rotor_speeds"."""

    def __init_subclass__(cls) -> None:
        """Enter it into the registry."""
        super().__init_subclass__()
        REGISTRY[cls.name] = cls

    @abstractmethod
    def decide(self, event: CollisionEvent, last: Decision | None) -> Decision | None:
        """Return where to go after a collision, or None to let the mission go on.

        Args:
            event: the collision; its flight direction is a unit vector.
            last: the decision on the collision before this one, if there was one.
        """


def reaction_from_mapping(values: Any, section: str = "reaction") -> Reaction:
    """Return a reaction from plain values: `name`, the paper's by default, and its parameters.

    Raises:
        InputError: unknown name or key, wrong type, NaN or a value out of bounds.
    """
    given = dict(values) if isinstance(values, Mapping) else values
    name = given.pop("name", DEFAULT) if isinstance(given, dict) else DEFAULT
    if name not in REGISTRY:
        raise unknown_name(f"{section}.name", str(name), REGISTRY)
    return from_mapping(REGISTRY[name], given, section)


for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

"""The reactions to a collision by name, one file each; a file in this folder is all it takes.

A reaction is a frozen dataclass of its parameters (`tombo_dynamics.params.param`: value, unit,
bounds, meaning) with a `name`, what it `needs`, and a method `begin`. Scenarios
(`reaction: {name: bounce}`), `--set reaction.distance=1`, `tombo reactions`, the
node's parameters, the documentation and the generic tests follow.
"""

from __future__ import annotations

import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

from tombo_collision.decision import Decision, Estimate
from tombo_dynamics.errors import unknown_name
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import from_mapping

DEFAULT = "bounce"
REGISTRY: dict[str, type[Reaction]] = {}
"""Name -> reaction."""
EVENT_TOPICS = {"mocap": "/collision_event", "imu": "/contact_event"}
"""Sensor -> topic of the collisions that are seen in it."""


@dataclass(frozen=True)
class Reaction(ABC):
    """A reaction and its parameters. It decides from messages alone."""

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("mocap",)
    """Sensors that it takes collisions from: mocap (the detector), imu (the contact trigger)."""
    recovers: ClassVar[bool] = False
    """While it guides, and at a contact, the controller flies with the recovery's gains."""

    def __init_subclass__(cls) -> None:
        """Enter it into the registry."""
        super().__init_subclass__()
        REGISTRY[cls.name] = cls

    @classmethod
    def event_topics(cls) -> tuple[str, ...]:
        """Return the topics of the collisions that it takes."""
        return tuple(topic for sensor, topic in EVENT_TOPICS.items() if sensor in cls.needs)

    @abstractmethod
    def begin(
        self, event: CollisionEvent, estimate: Estimate, last: Decision | None
    ) -> Decision | None:
        """Return where to go after a collision, or None to let the mission go on.

        Args:
            event: the collision; its flight direction is a unit vector.
            estimate: the newest one.
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

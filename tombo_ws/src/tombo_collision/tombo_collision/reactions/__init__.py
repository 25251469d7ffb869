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

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import unknown_name
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import from_mapping

DEFAULT = "bounce"
REGISTRY: dict[str, type[Reaction]] = {}
"""Name -> reaction."""
EVENT_TOPICS = {"mocap": "/collision_event", "imu": "/contact_event"}
"""Sensor -> topic of the collisions that are seen in it."""


@dataclass(frozen=True)
class Estimate:
    """The newest estimate that has come."""

    position: Array
    """(3) of base_link in map [m]."""
    velocity: Array
    """(3) in map [m/s]."""
    attitude: Array
    """(4) quaternion xyzw, map from base_link."""
    rates: Array
    """(3) [rad/s], base_link."""


@dataclass(frozen=True)
class Reference:
    """Where the vehicle shall be now."""

    position: Array
    """(3) in map [m]."""
    velocity: Array
    """(3) in map, fed forward [m/s]."""
    acceleration: Array
    """(3) in map, fed forward [m/s^2]."""
    yaw: float
    """[rad]"""


@dataclass
class Decision:
    """What a reaction decides on a collision. Positions and directions in map.

    With `guides` the set point is its `reference` until it is `over`; without, x_r at once, until
    the mission flies there.
    """

    guides: ClassVar[bool] = False

    x_c: Array
    """(3) base_link at contact [m]."""
    n_r: Array
    """(3) unit vector, from x_c to x_r."""
    x_r: Array
    """(3) where to hold [m]."""

    def reference(self, time_s: float, estimate: Estimate) -> Reference:
        """Return the set point so long after the decision; asked at 50 Hz while it guides."""
        raise NotImplementedError

    def over(self, time_s: float, estimate: Estimate) -> bool:
        """Return whether the mission holds x_r from now on; asked before each reference."""
        return True


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

"""The reactions to a collision by name, one file each; a file in this folder is all it takes.

A reaction is a frozen dataclass of its parameters (`tombo_dynamics.params.param`: value, unit,
bounds, meaning) with a `name`, its `needs`, and a method `begin`. Scenarios
(`reaction: {name: bounce}`), `--set reaction.distance=1`, `tombo list reactions`, the
node's parameters, the documentation and the generic tests follow.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from tombo_collision.decision import Decision, Estimate, Guided, against_flight, back_off, length
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import import_each, unknown_name
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import from_mapping, param
from tombo_dynamics.rotation import yaw_of

DEFAULT = "bounce"
REGISTRY: dict[str, type[Reaction]] = {}
"""Name -> reaction."""
_LEAST_DIRECTION = 0.1
"""A mixture of push and flight that is shorter has no direction."""
EVENT_TOPICS = {"mocap": "/collision_event", "imu": "/contact_event"}
"""Sensor -> topic of the collisions that are seen in it."""


@dataclass(frozen=True)
class Reaction(ABC):
    """A reaction and its parameters. It decides from messages alone."""

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("mocap",)
    """Sensors that it takes collisions from: mocap (the detector), imu (the contact trigger)."""
    recovers: ClassVar[bool] = False
    """At a contact, and while a `Guided` decision holds, the controller flies with the gains of
    the recovery."""

    def __init_subclass__(cls) -> None:
        """Enter it into the registry, if it has a name of its own."""
        super().__init_subclass__()
        if "name" in vars(cls):
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


@dataclass(frozen=True)
class OffSurface(Reaction):
    """What reactions share that leave along the push, and guide the vehicle on the way."""

    needs: ClassVar[tuple[str, ...]] = ("mocap", "imu")

    distance: float = param(0.8, "m", (0.05, 20.0), "d_r, from x_c to x_r", "as bounce")
    height_min: float = param(
        0.7, "m", (0.0, 100.0), "x_r is not put below this height", "clear of ground effect"
    )
    push_share: float = param(
        1.0,
        "1",
        (0.0, 1.0),
        "share of the push's direction in n_r, the rest is against the flight",
        "the push points off the surface: the neighbour's disc leaves it too",
    )
    timeout: float = param(
        4.0,
        "s",
        (0.5, 60.0),
        "after this time the mission holds x_r with the cascade's gains",
        "three times the recovery",
    )

    def begin(self, event: CollisionEvent, estimate: Estimate, last: Decision | None) -> Decision:
        """Return the way to x_r = x_c + d_r n_r."""
        x_c, n_r = event.contact_position, self._off_surface(event)
        x_r = back_off(x_c, n_r, self.distance, self.height_min)
        return self.way(Guided(x_c, n_r, x_r, self.timeout, yaw_of(estimate.attitude)), estimate)

    def way(self, decision: Guided, estimate: Estimate) -> Guided:
        """Return the way of this reaction in place of the one that rests at x_r."""
        return decision

    def _off_surface(self, event: CollisionEvent) -> Array:
        """Return n_r (3): along the push, in part or whole; against the flight without one."""
        against = against_flight(event.flight_direction)
        mixed = (1.0 - self.push_share) * against + self.push_share * event.push
        size = length(mixed)
        return mixed / size if size > _LEAST_DIRECTION else against


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


import_each(__name__, __path__)

"""Flights that begin in flight: from the state, kept, in which another flight was at that time.

What acts only where the obstacle is touched may differ from the flight that was kept; so the rest
of a flight can be flown many times, with other noise and another obstacle, without its beginning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tombo_dynamics.effects import REGISTRY
from tombo_flight.scenario import Scenario
from tombo_sim.flight_loop import forget_messages
from tombo_sim.kernel import Flights
from tombo_sim.world import ObstacleParams, StartParams

FlyToStart = Callable[[Scenario, int], Flights]
"""Flies a scenario with a seed to its end."""
_WHOLE = ("captures", "counts", "read", "progress")


@dataclass
class KeptStarts:
    """Beginnings of the flights of one scenario, by seed."""

    _of: Scenario | None = None
    _kept: dict[int, Flights] = field(default_factory=dict)

    def get(self, scenario: Scenario, seed: int, fly: FlyToStart) -> Flights:
        """Return the state at the start of a flight, flown if it is not there.

        Args:
            scenario: with a start in flight.
            seed: of the flight that begins on the ground.
            fly: flies it to its end.
        """
        before = _before_contact(scenario)
        if self._of != before:
            self._of, self._kept = before, {}
        if seed not in self._kept:
            self._kept[seed] = _state_of(fly(before, seed))
        return self._kept[seed]


def _before_contact(scenario: Scenario) -> Scenario:
    """Return the flight up to the start, without what acts only at the obstacle."""
    effects = {k: v for k, v in scenario.effects.items() if not REGISTRY[k].contact}
    return replace(
        scenario,
        duration=scenario.start.time,
        start=StartParams(),
        obstacle=ObstacleParams(),
        effects=effects,
    )


def _state_of(flights: Flights) -> Flights:
    """Return a copy of a flight without what it has behind it: messages taken, poses delivered."""
    forget_messages(flights, 0)
    counts, captures = flights.counts[0], flights.captures[0]
    under_way = slice(int(captures.oldest_undelivered), int(captures.next))
    copied: Flights = _copied(flights)
    tables = zip(flights.published, counts, strict=True)
    return copied._replace(
        published=tuple(table[:, :count].copy() for table, count in tables),
        entries=flights.entries[:, under_way].copy(),
    )


def _copied(arrays: Any) -> Any:
    if isinstance(arrays, tuple):
        parts = [_copied(part) for part in arrays]
        return type(arrays)(*parts) if hasattr(arrays, "_fields") else tuple(parts)
    return arrays.copy()


def begin_in_flight(flights: Flights, kept: Flights) -> None:
    """Put a flight that is on the ground, with its own obstacle, into a state that was kept."""
    obstacle = flights.plant["obstacle"].copy()
    _copy(kept.plant, flights.plant)
    flights.plant["obstacle"] = obstacle
    for name in _WHOLE:
        _copy(getattr(kept, name), getattr(flights, name))
    for memories, kept_memories in zip(flights.memories, kept.memories, strict=True):
        for memory, kept_memory in zip(memories, kept_memories, strict=True):
            _copy(kept_memory, memory)
    for table, rows in zip(flights.published, kept.published, strict=True):
        if rows.size:
            _copy(rows, table[:, : rows.shape[1]])
    first = int(kept.captures[0].oldest_undelivered)
    flights.entries[:, first : first + kept.entries.shape[1]] = kept.entries


def _copy(source: Any, target: Any) -> None:
    """Copy records as bytes: numpy alone copies them field by field, which takes long."""
    target.view(np.uint8)[:] = source.view(np.uint8)

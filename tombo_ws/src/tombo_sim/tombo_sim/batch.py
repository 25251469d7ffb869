"""Many fused flights in one array each, stepped from decision to decision: for training.

The flight is `flight_loop.fly`, tick for tick; a vehicle stops where its reaction's reference is
due, takes an action, and goes on. No log is kept, and of the messages only what is to be read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tombo_collision.reaction_core import check_event, has_come, is_same_contact, reference_due
from tombo_collision.steering import ACTIONS, HIGH, Steering, observe, steer, steering_over
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import Core
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import rotated
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_sim.flight_loop import (
    COLLISION,
    CONTACT,
    REACTION,
    fly,
    forget_messages,
    new_flights,
    step_reaction,
)
from tombo_sim.kernel import Flights, Shared
from tombo_sim.normals import draw_normals

FLIES, WAITS, ACTS, COLLIDED, HANDED, OVER, ENDED = range(7)
"""State of a vehicle of a batch: flies; waits for an action; has one; waits for its collision to
be handed to the reaction; it has been; its decision is over; its flight has ended."""
BLOCK = 64
"""Ticks between two drawings of random numbers."""


class Batch(NamedTuple):
    """Flights of N vehicles; each array has them along its first axis."""

    flights: Flights
    streams: Any
    """(N, 4) of their random numbers, `normals.stream_of`."""
    steering: Any
    status: Any
    """(N) `FLIES` and so on."""
    action: Array
    """(N, 6) to take, `steering.steer`."""
    observation: Any
    """(N, 23) float32, `steering.observe`."""
    time: Array
    """(N) [s] since the decision, of the observation."""


def new_batch(count: int, plant: Any, theta: Array, cores: Sequence[Core], captures: int) -> Batch:
    """Return `count` flights with room for `captures` poses each.

    Args:
        count: N.
        plant: a vehicle as of `flight_setup.begin`; its type counts.
        theta: parameters of its effects; their number counts.
        cores: those of the wiring; the types of their memories count.
        captures: most poses of one.

    Raises:
        InputError: a core that is not compiled.
    """
    for core in cores:
        if core.compiled is None:
            raise InputError(f"core '{core.name}': many flights at a time; accepted: compiled")
    return Batch(
        new_flights(count, plant, theta, cores, captures, BLOCK),
        np.zeros((count, 4), np.uint64),
        np.zeros(count, Steering.layout),
        np.full(count, ENDED, np.int64),
        np.zeros((count, ACTIONS)),
        np.zeros((count, HIGH.size), np.float32),
        np.zeros(count),
    )


@compiled(inline=False, counted=False)  # references would be a quarter of a step's time
def fly_batch(batch: Batch, shared: Shared, first: int, last: int) -> None:
    """Fly vehicles `first` to `last` - 1 until each waits, is over, has collided, or ends.

    Args:
        batch: changed.
        shared: their common data.
        first: of the vehicles.
        last: one more than the last of them.
    """
    flights = batch.flights
    for i in range(first, last):
        flight = flights.progress[i]
        reaction = flights.memories[REACTION][0][i]
        status = batch.status[i]
        if status == ACTS:
            _take_action(batch.steering[i], reaction, batch.action[i], flight.tick - 1)
            step_reaction(flights, shared, i)
            status = FLIES
        elif status == HANDED:
            status = _decide(batch, shared, i, reaction)
        while status == FLIES and flight.tick < flight.end:
            if flight.tick >= flights.base[i] + BLOCK:
                flights.base[i] = flight.tick
                draw_normals(batch.streams[i], flights.noise[i])
                forget_messages(flights, i)
            if fly(flights, shared, i, flights.base[i] + BLOCK):
                known = not flight.python_input or _all_known(flights, shared, i, reaction)
                if reaction.pending > 0 or not known:
                    status = COLLIDED
                else:
                    status = _decide(batch, shared, i, reaction)
        if status == FLIES and flight.tick >= flight.end:
            status = ENDED
        batch.status[i] = status


@compiled(inline=False, counted=False)
def _all_known(flights: Flights, shared: Shared, i: int, reaction: Any) -> bool:
    """Take the collisions that came; False: of one the reaction does not know, in Python."""
    limits, now = (
        shared.params[REACTION][0][0],
        EPOCH_NS + (flights.progress[i].tick - 1) * TICK_NS,
    )
    fresh, there = flights.fresh[i], flights.there[i]
    seen, felt = flights.published[COLLISION][i], flights.published[CONTACT][i]
    return _take_known(reaction, limits, seen, fresh, there, COLLISION, now) and _take_known(
        reaction, limits, felt, fresh, there, CONTACT, now
    )


@compiled(inline=False, counted=False)
def _take_known(
    reaction: Any, limits: Any, table: Any, fresh: Any, there: Any, k: int, now: int
) -> bool:
    """Take collisions from table k up to one that the reaction does not know: then False."""
    while fresh[k] < there[k]:
        event = table[fresh[k]].message
        if not (has_come(reaction, event) or is_same_contact(reaction, event)):
            return False
        check_event(reaction, limits, event, now)
        fresh[k] += 1
    return True


@compiled(inline=False, counted=False)
def _take_action(steering: Any, reaction: Any, action: Array, tick: int) -> None:
    """Make the set point of an action the reaction's reference; as `ReactionCore` asks for it."""
    out = reaction.reference
    steer(steering, action, reaction.attitude, reaction.rates, out)
    out.phase = Phase.REACT
    reaction.reference_ns = EPOCH_NS + tick * TICK_NS
    reaction.publish_due = True


@compiled(inline=False, counted=False)
def _decide(batch: Batch, shared: Shared, i: int, reaction: Any) -> int:
    """Observe if an action is due, else step the reaction; return the new state of the vehicle."""
    now = EPOCH_NS + (batch.flights.progress[i].tick - 1) * TICK_NS
    if not reference_due(reaction, now):
        step_reaction(batch.flights, shared, i)
        return FLIES
    steering = batch.steering[i]
    time_s = 1e-9 * (now - steering.decided_ns)
    velocity = rotated(reaction.attitude, reaction.velocity)
    position, attitude, rates = reaction.position, reaction.attitude, reaction.rates
    batch.time[i] = time_s
    observe(steering, time_s, position, velocity, attitude, rates, batch.observation[i])
    return OVER if steering_over(steering, time_s, position, velocity, rates) else WAITS

"""Many fused flights in one array each, stepped from decision to decision: for training.

The flight is `kernel.fly`, tick for tick; a vehicle stops where its reaction's reference is due,
takes an action, and goes on. No log is kept, and of the messages only what is still to be read.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tombo_collision.reaction_core import reaction_step, reference_due
from tombo_collision.steering import ACTIONS, HIGH, Steering, observe, steer, steering_over
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled, compiled_call
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import rotated
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_sim import kernel
from tombo_sim.flight_setup import NOISE
from tombo_sim.kernel import (
    CoreMemories,
    FlightProgress,
    Published,
    fly,
    new_published,
    publish_reaction,
)
from tombo_sim.log_columns import new_log
from tombo_sim.sensing import Captures, MocapEntry

FLIES, WAITS, ACTS, COLLIDED, HANDED, OVER, ENDED = range(7)
"""What a vehicle of a batch does: flies; waits for an action; has one; waits for its collision to
be handed to the reaction; it has been; its decision is over; its flight has ended."""
BLOCK = 256
"""Ticks between two drawings of random numbers."""


class Batch(NamedTuple):
    """Flights of N vehicles; each array has them along its first axis."""

    plant: Any
    theta: Array
    noise: Array
    """(N, BLOCK, 9) standard normals, a row a tick."""
    base: Any
    """(N) tick of its first row."""
    capture_ticks: Any
    mocap_noise: Array
    entries: Any
    captures: Any
    cores: CoreMemories
    published: Published
    flight: Any
    log: Any
    """Empty: nothing is written down."""
    steering: Any
    status: Any
    """(N) `FLIES` and so on."""
    action: Array
    """(N, 6) to take, `steering.steer`."""
    observation: Any
    """(N, 23) float32, `steering.observe`."""
    time: Array
    """(N) [s] since the decision, of the observation."""


def new_batch(
    count: int, plant: Any, theta: Array, memories: CoreMemories, captures: int
) -> Batch:
    """Return room for `count` flights of so many poses.

    Args:
        count: N.
        plant: a vehicle as of `flight_setup.begin`; its type counts.
        theta: parameters of its effects; their number counts.
        memories: of the cores; their types count.
        captures: most poses of one.
    """
    tables = (np.zeros((count, t.size), t.dtype) for t in new_published(BLOCK, BLOCK))
    return Batch(
        np.zeros(count, plant.dtype),
        np.zeros((count, *theta.shape)),
        np.zeros((count, BLOCK, NOISE)),
        np.zeros(count, np.int64),
        np.zeros((count, captures), np.int64),
        np.zeros((count, captures, NOISE)),
        np.zeros((count, captures), MocapEntry.layout),
        np.zeros(count, Captures.layout),
        CoreMemories(*(np.zeros(count, memory.dtype) for memory in memories)),
        Published(*tables),
        np.zeros(count, FlightProgress.layout),
        new_log(0),
        np.zeros(count, Steering.layout),
        np.full(count, ENDED, np.int64),
        np.zeros((count, ACTIONS)),
        np.zeros((count, HIGH.size), np.float32),
        np.zeros(count),
    )


def row_of(batch: Any, i: int) -> Any:
    """Return vehicle `i` of a batch, or of tuples in it: views of its rows."""
    if isinstance(batch, tuple):
        return type(batch)(*(row_of(part, i) for part in batch))
    return batch[i : i + 1]


@compiled_call
def fly_batch(batch: Batch, maps: Any, params: Any, first: int, last: int) -> None:
    """Fly vehicles `first` to `last` - 1 until each waits, is over, ends, or needs random numbers.

    Args:
        batch: changed.
        maps: (1) the rotor's table.
        params: parameters of the cores.
        first: of the vehicles.
        last: one more than the last of them.
    """
    for i in range(first, last):
        cores = CoreMemories(
            batch.cores.estimator[i],
            batch.cores.estimator_autopilot[i],
            batch.cores.detector[i],
            batch.cores.reaction[i],
            batch.cores.mission[i],
            batch.cores.controller[i],
            batch.cores.controller_autopilot[i],
        )
        published = Published(
            batch.published.odometry[i],
            batch.published.estimator_status[i],
            batch.published.detector_status[i],
            batch.published.event[i],
            batch.published.reaction_status[i],
            batch.published.setpoint[i],
            batch.published.mission_setpoint[i],
            batch.published.mission_status[i],
            batch.published.contact[i],
        )
        flight, steering, reaction = batch.flight[i], batch.steering[i], cores.reaction
        status = batch.status[i]
        if status == ACTS:
            _take_action(steering, reaction, batch.action[i], flight.tick - 1)
            _step_reaction(reaction, params.reaction, published, flight)
            status = FLIES
        elif status == HANDED:
            status = _decide(batch, i, steering, reaction, params.reaction, published, flight)
        vehicle = (batch.plant[i], maps[0], batch.theta[i], batch.noise[i])
        poses = (batch.capture_ticks[i], batch.mocap_noise[i], batch.entries[i], batch.captures[i])
        base = batch.base[i]
        while status == FLIES and flight.tick < min(base + BLOCK, flight.end):
            if flight.tick == base:
                _forget_messages(published, flight)
            stop = base + BLOCK
            if fly(vehicle, poses, cores, params, published, flight, batch.log, base, stop):
                if _has_collision(reaction, published, flight):
                    status = COLLIDED
                else:
                    status = _decide(
                        batch, i, steering, reaction, params.reaction, published, flight
                    )
        if status == FLIES and flight.tick >= flight.end:
            status = ENDED
        batch.status[i] = status


@compiled_call
def _take_action(steering: Any, reaction: Any, action: Array, tick: int) -> None:
    """Make the set point of an action the reaction's reference; as `ReactionCore` asks for it."""
    out = reaction.reference
    steer(steering, action, reaction.attitude, reaction.rates, out)
    out.phase = Phase.REACT
    reaction.reference_ns = EPOCH_NS + tick * TICK_NS
    reaction.publish_due = True


@compiled_call
def _step_reaction(reaction: Any, limits: Any, published: Any, flight: Any) -> None:
    tick = flight.tick - 1
    reaction_step(reaction, limits, EPOCH_NS + tick * TICK_NS)
    publish_reaction(reaction, published, flight, tick)


@compiled_call
def _has_collision(reaction: Any, published: Any, flight: Any) -> bool:
    """Return whether the reaction has a collision to take in the last tick."""
    last, found = flight.tick - 2, reaction.pending > 0
    count = flight.published[kernel.EVENT]
    if count > 0:
        found |= published.event[count - 1].tick == last
    count = flight.published[kernel.CONTACT]
    if count > 0 and reaction.takes_contacts:
        found |= published.contact[count - 1].tick == last
    return bool(found)


@compiled_call
def _decide(
    batch: Any, i: int, steering: Any, reaction: Any, limits: Any, published: Any, flight: Any
) -> int:
    """Observe if an action is due, else step the reaction; return what the vehicle does now."""
    now = EPOCH_NS + (flight.tick - 1) * TICK_NS
    if not reference_due(reaction, now):
        _step_reaction(reaction, limits, published, flight)
        return FLIES
    time_s = 1e-9 * (now - steering.decided_ns)
    velocity = np.empty(3)
    v = reaction.velocity
    velocity[0], velocity[1], velocity[2] = rotated(reaction.attitude, v[0], v[1], v[2])
    position, attitude, rates = reaction.position, reaction.attitude, reaction.rates
    batch.time[i] = time_s
    observe(steering, time_s, position, velocity, attitude, rates, batch.observation[i])
    return OVER if steering_over(steering, time_s, position, velocity, rates) else WAITS


@compiled_call
def _forget_messages(published: Any, flight: Any) -> None:
    """Keep of each topic the last message, and what the mission has not read."""
    counts = flight.published
    gone = _keep(published.odometry, counts, kernel.ODOMETRY, flight.read_odometry)
    flight.read_odometry -= gone
    gone = _keep(published.reaction_status, counts, kernel.REACTION_STATUS, flight.read_reaction)
    flight.read_reaction -= gone
    gone = _keep(published.setpoint, counts, kernel.SETPOINT, flight.read_setpoint)
    flight.read_setpoint -= gone
    many = 1 << 62
    _keep(published.estimator_status, counts, kernel.ESTIMATOR_STATUS, many)
    _keep(published.detector_status, counts, kernel.DETECTOR_STATUS, many)
    _keep(published.event, counts, kernel.EVENT, many)
    _keep(published.mission_setpoint, counts, kernel.MISSION_SETPOINT, many)
    _keep(published.mission_status, counts, kernel.MISSION_STATUS, many)
    _keep(published.contact, counts, kernel.CONTACT, many)


@compiled
def _keep(table: Any, counts: Any, topic: int, read: int) -> int:
    """Move what is kept to the front of a table; return how many rows are gone before it."""
    gone = min(read, counts[topic] - 1)
    if gone <= 0:
        return 0
    counts[topic] -= gone
    for k in range(counts[topic]):
        table[k] = table[gone + k]
    return int(gone)

"""Episodes of recovery from a collision, many at a time, for the training environments.

An episode is the rest of a flight from the reaction's first decision on. The flight up to there is
that of `tombo fly` with the same seed, to the last bit; so is what follows, if the reaction
`policy` flies it with a network that gives the same actions.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tombo_collision.reaction_core import ReactionCore
from tombo_collision.reactions.policy import Policy, Steered
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import tilt
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS, TICK_S
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.flight_metrics import STABLE_RATE, STABLE_TILT, lowest_point, squares
from tombo_flight.scenario import Scenario, world_of
from tombo_flight.wiring import core_of
from tombo_sim.batch import (
    ACTS,
    BLOCK,
    COLLIDED,
    ENDED,
    FLIES,
    HANDED,
    OVER,
    Batch,
    fly_batch,
    new_batch,
)
from tombo_sim.flight_loop import REACTION, hand_over, memories_of, shared_by
from tombo_sim.flight_setup import NOISE, begin, capture_ticks
from tombo_sim.normals import stream_of
from tombo_sim.wiring import CORES

CRASH_COST = 10.0
"""Cost of a crash, in seconds of recovery."""
_NEVER = 2**62
"""Tick that no flight reaches."""
_BLOCK, _FRESH_BLOCK = 32, 4
"""Vehicles that a thread takes at a time: for a step; where some start on the ground, whose
flights differ in length."""
_TRIES = 20
"""Flights in a row without a collision before a scenario is refused."""


@dataclass
class _Pilot:
    """The Python objects of one vehicle's flight, which its arrays can't hold."""

    reaction: ReactionCore
    decision: Any = None
    """The reaction's last decision that a policy steers."""


@dataclass
class Outcome:
    """Result of a step, each (N)."""

    reward: Array
    """Minus the sum of time, twice while unstable [s], new depth of fall [m], and `CRASH_COST`."""
    terminated: Any
    """The vehicle rests at x_r, or has crashed."""
    truncated: Any
    """Time is up."""
    crashed: Any


class Episodes:
    """N vehicles, each in an episode of its own."""

    def __init__(
        self, scenario: Scenario, count: int, threads: int = 1, starts: int | None = None
    ) -> None:
        """Make room for the flights of a scenario.

        Args:
            scenario: the flight; its reaction must be `policy`, whose network is not asked.
            count: N.
            threads: that fly at the same time.
            starts: number of flights up to the collision that are kept and begun from again: those
                of seeds 0 to `starts` - 1. None: each is flown.

        Raises:
            InputError: another reaction; as `flight_setup.begin`.
        """
        if not isinstance(scenario.reaction, Policy):
            raise InputError(f"reaction '{scenario.reaction.name}'; accepted: policy")
        self.scenario, self.count, self.starts = scenario, count, starts
        setup = begin(world_of(scenario), 0)
        cores = self._cores()
        rate = max(setup.mocap_rate, scenario.estimator.mocap_rate, scenario.spread.mocap_rate)
        self._ticks = round(scenario.duration / TICK_S)
        captures = math.ceil(scenario.duration * rate) + 2
        self._shared = shared_by(setup.maps, cores)
        self.batch: Batch = new_batch(count, setup.plant, setup.theta, cores, captures)
        flights = self.batch.flights._replace(entries=(), published=())  # the flights in use
        self._rows = _bytes_of(self.batch._replace(flights=flights))
        self._tables = _bytes_of(self.batch.flights.published)
        self._row_sizes = np.array([table.itemsize for table in self.batch.flights.published])
        self._state = self.batch.flights.plant["state"]
        self._low = _reach(scenario.vehicle) + 0.01
        self._pilots: list[Any] = [None] * count
        self._kept: dict[int, Any] = {}
        self._threads = min(threads, count)
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        self.seeds = np.zeros(count, np.int64)
        self._lowest: Array = np.zeros(count)
        self._tick = np.zeros(count, np.int64)

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    @property
    def observation(self) -> Any:
        """(N, 23) float32, `tombo_collision.steering.OBSERVATION`; a copy."""
        return self.batch.observation.copy()

    @property
    def position(self) -> Array:
        """(N, 3) true, in map [m]."""
        place: Array = self._state["position"]
        return place

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator], seeds: Any) -> None:
        """Begin new episodes, and fly on vehicles that have an action.

        Args:
            which: vehicles.
            rngs: of each, that draws seeds of flights.
            seeds: of each the flight's seed, or None to draw it.

        Raises:
            InputError: a scenario in which nothing collides.
        """
        missing = [(i, rng, seed) for i, rng, seed in zip(which, rngs, seeds, strict=True)]
        for _ in range(_TRIES):
            drawn = (int(r.integers(2**31)) if seed is None else seed for _, r, seed in missing)
            self._begin_all([(i, seed) for (i, _, _), seed in zip(missing, drawn, strict=True)])
            missing = [(i, rng, None) for i, rng, _ in missing if self.batch.status[i] == ENDED]
            if not missing:
                break
        else:
            raise InputError(
                f"scenario '{self.scenario.name}': {_TRIES} flights without a collision; "
                "accepted: one in which the vehicle meets an obstacle"
            )
        begun = list(which)
        self._lowest[begun] = self.position[begun, 2]
        self._tick[begun] = self.batch.flights.progress["tick"][begun]

    def _begin_all(self, episodes: Sequence[tuple[int, int]]) -> None:
        """Fly vehicles, each with a seed, to their collision; of a start to be kept only one."""
        flown: dict[int, int] = {}
        others = []
        for i, seed in episodes:
            start = i if self.starts is None else seed % self.starts
            if start in flown and start not in self._kept:
                self.batch.status[i] = ENDED  # until the start is kept
                others.append((i, seed))
            else:
                flown[start] = i
                self._begin(i, seed)
        self._fly(any(start not in self._kept for start in flown))
        for i in flown.values():
            self._keep(i)
        for i, seed in others:
            self._begin(i, seed)

    def step(self, actions: Array, acting: Any, **reset: Any) -> Outcome:
        """Fly 20 ms with an action each.

        Args:
            actions: (N, 6), `tombo_collision.steering.steer`.
            acting: (N) whose action counts.
            reset: arguments of `reset` for others, if any.
        """
        batch = self.batch
        batch.action[acting] = actions[acting]
        batch.status[acting] = ACTS
        if reset:
            self.reset(**reset)
        else:
            self._fly(fresh=False)
        return self._outcome(acting)

    def _outcome(self, acting: Any) -> Outcome:
        batch, position, attitude = self.batch, self.position, self._state["attitude"]
        rate = np.sqrt(squares(self._state["rates"]))
        unstable = (tilt(attitude) >= STABLE_TILT) | (rate >= STABLE_RATE)
        crashed = acting & (position[:, 2] < self._low)
        if crashed.any():
            low = np.flatnonzero(crashed)
            crashed[low] = lowest_point(self.scenario.vehicle, position[low], attitude[low]) < 0.0
        over, ended = acting & (batch.status == OVER), acting & (batch.status == ENDED)
        late = batch.time > batch.steering["timeout"]
        lowest = np.minimum(self._lowest, position[:, 2])
        ticks = batch.flights.progress["tick"]
        cost = (ticks - self._tick) * TICK_S * (1.0 + unstable) + (self._lowest - lowest)
        reward = np.where(acting, -cost - CRASH_COST * crashed, 0.0)
        self._lowest, self._tick = lowest, ticks.copy()
        return Outcome(
            reward, crashed | (over & ~late), ~crashed & ((over & late) | ended), crashed
        )

    def _cores(self) -> list[Any]:
        return [core_of(kind, self.scenario) for kind in CORES]

    def _begin(self, i: int, seed: int) -> None:
        """Put a vehicle on the ground, or where a kept flight has met the obstacle."""
        if self.starts is not None:
            seed %= self.starts
        self.seeds[i] = seed
        if seed in self._kept:
            row, under_way, first, pilot = self._kept[seed]
            for rows, kept in zip(self._rows + self._tables, row, strict=True):
                rows[i, : kept.size] = kept
            flights = self.batch.flights
            flights.entries[i, first : first + under_way.size] = under_way
            self._pilots[i] = pilot
            return
        flights, scenario = self.batch.flights, self.scenario
        setup, cores = begin(world_of(scenario), seed), self._cores()
        for rows, memory in zip(
            _bytes_of(flights.memories), _bytes_of(memories_of(cores)), strict=True
        ):
            rows[i] = memory[0]
        self._pilots[i] = _Pilot(cores[REACTION])
        flights.plant[i], flights.theta[i] = setup.plant, setup.theta
        self.batch.streams[i] = stream_of(setup.tick_noise)
        captures = capture_ticks(scenario.duration, setup.mocap_rate)
        flights.capture_ticks[i] = _NEVER
        flights.capture_ticks[i, : captures.size] = captures
        normals = setup.mocap_noise.standard_normal((captures.size + 1, NOISE))
        flights.mocap_noise[i, : captures.size + 1] = normals
        for array in (
            flights.entries, flights.captures, flights.progress, flights.counts, flights.there,
            flights.fresh, flights.waiting, self.batch.steering,
        ):  # fmt: skip
            array[i] = np.zeros((), array.dtype)
        flights.progress["end"][i] = self._ticks
        flights.progress["over"]["ground"][i] = scenario.vehicle.leg_height
        flights.base[i], self.batch.status[i] = -BLOCK, FLIES

    def _keep(self, i: int) -> None:
        """Keep the start of vehicle `i` to begin from again."""
        seed = int(self.seeds[i])
        if self.starts is not None and seed not in self._kept:
            captures = self.batch.flights.captures[i]
            first, last = int(captures.oldest_undelivered), int(captures.next)
            under_way = self.batch.flights.entries[i, first:last].copy()
            used = self.batch.flights.counts[i] * self._row_sizes
            row = [rows[i].copy() for rows in self._rows]
            row += [t[i, :size].copy() for t, size in zip(self._tables, used, strict=True)]
            self._kept[seed] = (row, under_way, first, self._pilots[i])

    def _fly(self, fresh: bool) -> None:
        """Fly all vehicles until each waits for an action or has ended.

        `fresh`: some start on the ground. Their flights differ in length, so blocks are small and
        threads share the work better. The reaction decides on a collision in Python; that vehicle
        then flies on.
        """
        length = min(_FRESH_BLOCK if fresh else _BLOCK, math.ceil(self.count / self._threads))
        blocks = [(i, min(i + length, self.count)) for i in range(0, self.count, length)]
        while blocks:
            self._fly_blocks(blocks)
            collided = np.flatnonzero(self.batch.status == COLLIDED).tolist()
            for i in collided:
                self._hand_collision(i)
            blocks = [(i, i + 1) for i in collided]

    def _fly_blocks(self, blocks: Sequence[tuple[int, int]]) -> None:
        """Fly vehicles from the first to before the last of each block, on all threads."""
        waiting = iter(blocks)

        def fly_next() -> None:
            for first, last in waiting:
                fly_batch(self.batch, self._shared, first, last)

        helpers = min(self._threads, len(blocks)) - 1
        at_work = [self._pool.submit(fly_next) for _ in range(helpers)] if self._pool else []
        fly_next()
        for future in at_work:
            future.result()

    def _hand_collision(self, i: int) -> None:
        """Hand the reaction a collision of vehicle `i`, and write its decision into the batch."""
        batch = self.batch
        pilot = self._pilots[i] = _clone(self._pilots[i])  # others may begin with the same one
        pilot.reaction.memory = batch.flights.memories[REACTION][0][i]
        tick = int(batch.flights.progress["tick"][i]) - 1
        now_ns = EPOCH_NS + tick * TICK_NS
        hand_over(batch.flights, i, pilot.reaction)
        pilot.reaction.take_early_events(now_ns)
        decision = pilot.reaction.decision
        if isinstance(decision, Steered) and decision is not pilot.decision:
            pilot.decision = decision
            batch.steering[i] = decision.steering
            batch.steering["decided_ns"][i] = now_ns
        batch.status[i] = HANDED


def _clone(pilot: _Pilot) -> _Pilot:
    """Return a pilot whose flight goes on apart from this one's; decisions are never changed."""
    return replace(pilot, reaction=copy.copy(pilot.reaction))


def _reach(vehicle: VehicleParams) -> float:
    """Return how far legs and motors are from the centre at most [m]."""
    legs = math.hypot(vehicle.leg_spread * math.sqrt(2.0), vehicle.leg_height)
    return max(legs, math.hypot(vehicle.arm_length, vehicle.rotor_height))


def _bytes_of(arrays: Any) -> list[Any]:
    """Return all arrays (N, ...) as bytes (N, M): numpy copies records field by field."""
    if isinstance(arrays, tuple):
        return [part for array in arrays for part in _bytes_of(array)]
    return [arrays.reshape(arrays.shape[0], -1).view(np.uint8)]

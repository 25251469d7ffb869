"""Gymnasium environments: train a reaction, from the collision on.

    >>> import gymnasium, tombo.gym
    >>> env = gymnasium.make("TomboCollision-v0", scenario="pole", disturbances=True)
    >>> many = gymnasium.make_vec("TomboCollision-v0", num_envs=64)

docs/gym.md has observations, actions and rewards.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from tombo.flights import scenario_of, texts_of
from tombo_collision.reactions.policy import Policy
from tombo_collision.steering import ACTIONS, HIGH, LOW
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_flight.training import CRASH_COST, Episodes, Outcome

__all__ = ["CRASH_COST", "ID", "CollisionEnv", "CollisionVectorEnv"]

ID = "TomboCollision-v0"


def _episodes(
    scenario: str,
    count: int,
    threads: int,
    starts: int | None,
    disturbances: bool,
    settings: dict[str, Any],
) -> Episodes:
    if starts is not None and starts < 1:
        raise InputError(f"starts: {starts}; accepted: at least 1, or None")
    given = {"disturbances": True, **settings} if disturbances else settings
    chosen = scenario_of(scenario, texts_of(given), "reflex", None, None)
    steered = Policy(**vars(chosen.reaction))  # its actions come from the trainer, not a network
    return Episodes(replace(chosen, reaction=steered), count, threads, starts)


def _observed() -> spaces.Box:
    return spaces.Box(LOW.astype(np.float32), HIGH.astype(np.float32), dtype=np.float32)


def _acted() -> spaces.Box:
    return spaces.Box(-1.0, 1.0, (ACTIONS,), np.float32)


def _info(episodes: Episodes, outcome: Outcome | None = None) -> dict[str, Any]:
    """Return the arrays (N) of a step's info."""
    return {
        "flight_seed": episodes.seeds.copy(),
        "time_s": episodes.batch.time.copy(),
        "crashed": np.zeros(episodes.count, bool) if outcome is None else outcome.crashed,
    }


class CollisionEnv(gymnasium.Env[Any, Any], EzPickle):
    """One vehicle, from the reaction's decision until it rests, crashes, or time is up.

    `reset(seed=3)` is the collision of `tombo fly --seed 3`; a reset without a seed draws one.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - as gymnasium declares it

    def __init__(
        self,
        scenario: str = "paper_collision",
        *,
        disturbances: bool = False,
        starts: int | None = None,
        render_mode: None = None,
        **settings: Any,
    ) -> None:
        """Prepare the flights.

        Args:
            scenario: a name of `tombo list scenarios`, or a YAML file.
            disturbances: as --disturbances.
            starts: number of flights up to the collision, of seeds 0 to `starts` - 1, that are
            flown once as starting states. None: every episode has a flight of its own.
            render_mode: None; nothing is drawn.
            **settings: values of the scenario, keys as of --set.

        Raises:
            InputError: as of `tombo.fly`.
            TypeError: another `render_mode`, for callers that then leave it out.
        """
        if render_mode is not None:
            raise TypeError(f"render_mode {render_mode!r}: nothing is drawn; accepted: None")
        EzPickle.__init__(self, scenario, disturbances=disturbances, starts=starts, **settings)
        self.episodes = _episodes(scenario, 1, 1, starts, disturbances, settings)
        self.observation_space, self.action_space = _observed(), _acted()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Fly to a collision; return the first observation and its info."""
        super().reset(seed=seed)
        self.episodes.reset([0], [self.np_random], [seed])
        return self.episodes.observation[0], self._info(None)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly 20 ms with an action (6) in [-1, 1]."""
        actions = _checked(action, (ACTIONS,))[None]
        outcome = self.episodes.step(actions, np.array([True]))
        return (
            self.episodes.observation[0],
            float(outcome.reward[0]),
            bool(outcome.terminated[0]),
            bool(outcome.truncated[0]),
            self._info(outcome),
        )

    def _info(self, outcome: Outcome | None) -> dict[str, Any]:
        return {key: values[0].item() for key, values in _info(self.episodes, outcome).items()}


class CollisionVectorEnv(VectorEnv[Any, Any, Any]):
    """Many vehicles in one compiled loop; each flies as in an environment of its own.

    The step after the end of an episode begins the next one (`AutoresetMode.NEXT_STEP`).
    """

    metadata = {  # noqa: RUF012
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str = "paper_collision",
        *,
        disturbances: bool = False,
        starts: int | None = None,
        threads: int | None = None,
        **settings: Any,
    ) -> None:
        """Prepare the flights.

        Args:
            num_envs: vehicles.
            scenario: as of `CollisionEnv`, and so are the others.
            disturbances: as --disturbances.
            starts: flights up to the collision that are kept.
            threads: that fly at the same time; as many as this process may use if None.
            **settings: values of the scenario.

        Raises:
            InputError: as of `tombo.fly`.
        """
        if num_envs < 1 or (threads is not None and threads < 1):
            raise InputError(f"num_envs {num_envs}, threads {threads}; accepted: at least 1")
        cores = threads or len(os.sched_getaffinity(0))
        self.num_envs = num_envs
        self.episodes = _episodes(scenario, num_envs, cores, starts, disturbances, settings)
        self.single_observation_space, self.single_action_space = _observed(), _acted()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._random = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self._done = np.ones(num_envs, bool)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Fly all to a collision; vehicle i has `seed` + i, or the i-th of several seeds."""
        count = self.num_envs
        if seed is None or isinstance(seed, int):
            seeds = [None if seed is None else seed + i for i in range(count)]
        else:
            seeds = list(seed)
        if len(seeds) != count:
            raise InputError(f"seed: {len(seeds)} seeds; accepted: one, or {count}")
        for i, vehicle_seed in enumerate(seeds):
            if vehicle_seed is not None:
                self._random[i] = seeding.np_random(vehicle_seed)[0]
        self.episodes.reset(range(count), self._random, seeds)
        self._done[:] = False
        return self.episodes.observation, self._infos(None)

    def step(self, actions: Any) -> tuple[Any, Array, Any, Any, dict[str, Any]]:
        """Fly 20 ms with actions (N, 6) in [-1, 1]; episodes that are done begin anew instead."""
        given = _checked(actions, (self.num_envs, ACTIONS))
        again = np.flatnonzero(self._done).tolist()
        begin = {
            "which": again,
            "rngs": [self._random[i] for i in again],
            "seeds": [None] * len(again),
        }
        outcome = self.episodes.step(given, ~self._done, **(begin if again else {}))
        self._done = outcome.terminated | outcome.truncated
        return (
            self.episodes.observation,
            outcome.reward,
            outcome.terminated,
            outcome.truncated,
            self._infos(outcome),
        )

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        self.episodes.close()

    def _infos(self, outcome: Outcome | None) -> dict[str, Any]:
        info = _info(self.episodes, outcome)
        return {**info, **{f"_{key}": np.ones(self.num_envs, bool) for key in info}}


def _checked(actions: Any, shape: tuple[int, ...]) -> Array:
    given = np.asarray(actions, np.float64)
    if given.shape != shape or not np.isfinite(given).all():
        raise InputError(f"action: {given!s:.200}; accepted: finite numbers of shape {shape}")
    return given


if ID not in gymnasium.registry:
    gymnasium.register(
        ID, entry_point=CollisionEnv, vector_entry_point="tombo.gym:CollisionVectorEnv"
    )

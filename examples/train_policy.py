"""Train a small policy to recover from a collision, by the cross-entropy method: numpy alone.

    python examples/train_policy.py policy.json
    tombo sweep collisions reaction.name=bounce,reflex,policy:policy.json --seeds 5000:5030

Minutes on one core. Each generation flies policies drawn about the mean of the last one's best,
all from the same collisions. The first mean is the zero action: what reaction `reflex` does. A
policy must learn to end at x_r, where only no action leaves it at rest: so the first spread is
small.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium
import numpy as np

import tombo.gym
from tombo_collision.network import network_text
from tombo_collision.steering import ACTIONS, HIGH

POLICIES, COLLISIONS, ELITE = 16, 12, 4
SPREAD = 0.02
SCALE = np.append(1.0 / np.where(HIGH == 10.0, 1.0, HIGH / 5.0), 1.0)
"""Makes inputs of a recovery's size of the order of one: m, 4 m/s, 10 rad/s, 12 s."""


def score(env: gymnasium.vector.VectorEnv, policies: np.ndarray) -> np.ndarray:
    """Return the mean sum of rewards of each policy (P, actions, inputs + 1)."""
    weights = np.repeat(policies, COLLISIONS, axis=0)
    seen, _ = env.reset(seed=[i % COLLISIONS for i in range(len(weights))])
    total, running = np.zeros(len(weights)), np.ones(len(weights), bool)
    while running.any():
        actions = np.tanh((weights[:, :, :-1] @ seen[:, :, None])[..., 0] + weights[:, :, -1])
        seen, reward, terminated, truncated, _ = env.step(actions)
        total += np.where(running, reward, 0.0)
        running &= ~(terminated | truncated)
    return total.reshape(len(policies), COLLISIONS).mean(axis=1)


def train(scenario: str, generations: int, seed: int) -> np.ndarray:
    """Return the weights (actions, inputs + 1) of a layer."""
    rng = np.random.default_rng(seed)
    env = gymnasium.make_vec(
        tombo.gym.ID,
        num_envs=POLICIES * COLLISIONS,
        vectorization_mode="vector_entry_point",
        scenario=scenario,
        disturbances=True,
        starts=COLLISIONS,
        threads=1,
    )
    mean = np.zeros((ACTIONS, HIGH.size + 1))
    spread = np.full_like(mean, SPREAD)
    best, highest = mean, -np.inf
    for generation in range(generations):
        drawn = mean + spread * rng.standard_normal((POLICIES, *mean.shape))
        drawn[0] = mean
        scores = score(env, drawn * SCALE)
        order = np.argsort(scores)
        if scores[order[-1]] > highest:
            best, highest = drawn[order[-1]], scores[order[-1]]
        elite = drawn[order[-ELITE:]]
        mean, spread = elite.mean(axis=0), 0.8 * elite.std(axis=0) + 0.2 * spread
        print(f"{generation}: mean {scores[0]:.3f}, best so far {highest:.3f}", flush=True)
    env.close()
    return best * SCALE


def main() -> None:
    """Train, and write the file of the policy."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--scenario", default="pole")
    parser.add_argument("--generations", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    given.file.write_text(network_text([train(given.scenario, given.generations, given.seed)]))


if __name__ == "__main__":
    main()

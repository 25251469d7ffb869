"""The training environments: gymnasium's contract, and the same flight as everywhere else."""

from __future__ import annotations

import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import tombo
import tombo.gym
from tombo_collision.network import answer, network_text
from tombo_collision.steering import ACTIONS, HIGH
from tombo_flight.training import Episodes

NETWORK = [
    np.random.default_rng(3).normal(0.0, 0.3, (8, HIGH.size + 1)),
    np.random.default_rng(4).normal(0.0, 0.3, (ACTIONS, 9)),
]


def network(tmp_path):
    path = tmp_path / "policy.json"
    path.write_text(network_text(NETWORK))
    return path, tuple(tuple(map(tuple, layer.tolist())) for layer in NETWORK)


def make(**given):
    return gymnasium.make(tombo.gym.ID, **given)


def make_vec(count, **given):
    mode = "vector_entry_point"
    return gymnasium.make_vec(tombo.gym.ID, num_envs=count, vectorization_mode=mode, **given)


def episode(env, seed, act):
    """Fly one; return observations, rewards, (tick, true position) of each step, and its end."""
    seen, info = env.reset(seed=seed)
    flight = env.unwrapped.episodes
    steps = [(seen, 0.0, int(flight.batch.flights.progress["tick"][0]), flight.position[0].copy())]
    done = False
    while not done:
        seen, reward, terminated, truncated, info = env.step(act(seen))
        done = terminated or truncated
        tick = int(flight.batch.flights.progress["tick"][0])
        steps.append((seen, reward, tick, flight.position[0].copy()))
    return steps, terminated, info


@pytest.mark.slow
def test_it_keeps_gymnasiums_contract():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make(disturbances=True).unwrapped)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "disturbances"), [("paper_collision", False), ("pole", True)]
)
def test_a_policy_flies_the_same_as_reaction_to_the_last_bit(tmp_path, scenario, disturbances):
    path, layers = network(tmp_path)
    env = make(scenario=scenario, disturbances=disturbances)
    steps, _, _ = episode(env, 4, lambda seen: answer(layers, seen))
    over = {"disturbances": True} if disturbances else {}
    given = {"reaction.network": str(path), **over}
    flight = tombo.fly(scenario, 4, reaction="policy", **given)
    log = flight.record.log
    assert len(steps) > 20
    for _, _, tick, position in steps:
        assert (log["position"][tick] == position).all()
    again = tombo.fly(scenario, 4, reaction="reflex", **over).record.log["position"]
    assert np.abs(again[steps[-1][2]] - steps[-1][3]).max() > 1e-3  # the policy's action counts


@pytest.mark.slow
def test_the_reward_is_made_of_the_arenas_figures():
    env = make()
    steps, arrived, info = episode(env, 2, lambda seen: np.zeros(ACTIONS))
    assert arrived and not info["crashed"]
    flight = tombo.fly("paper_collision", 2, reaction="reflex")
    first, last = steps[0][2], steps[-1][2]
    z = [place[2] for *_, place in steps]
    cost = -sum(reward for _, reward, _, _ in steps)
    duration = 1e-3 * (last - first)
    unstable = cost - duration - (z[0] - min(z))
    assert unstable == pytest.approx(flight.summary["unstable_phase_s"], abs=0.1)
    assert duration == pytest.approx(info["time_s"], abs=0.03)
    away = np.array([0.0, 0.0, -1.0, 0.0, 0.0, -1.0])
    steps, ended, info = episode(env, 2, lambda seen: away)
    if info["crashed"]:
        assert ended and steps[-1][1] < -tombo.gym.CRASH_COST
    worse = -sum(reward for _, reward, _, _ in steps)
    assert worse > cost + 1.0


@pytest.mark.slow
def test_many_fly_as_each_alone():
    count, rounds = 3, 2
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (600, count, ACTIONS)).astype(np.float32)
    many = make_vec(count, scenario="pole", disturbances=True, threads=2)
    rows = [[(seen, 0.0, False)] for seen in many.reset(seed=10)[0]]
    for action in actions:
        seen, reward, terminated, truncated, info = many.step(action)
        for i in range(count):
            rows[i].append((seen[i], reward[i], terminated[i] or truncated[i]))
        if min(sum(done for *_, done in row) for row in rows) >= rounds:
            break
    assert info["flight_seed"].shape == (count,)
    for i, row in enumerate(rows):
        env = make(scenario="pole", disturbances=True)
        env.reset(seed=10 + i)
        done = False
        for k, (seen, reward, ends) in enumerate(row[1:]):
            if done:  # the step after the end begins anew, whatever the action
                alone, done = env.reset()[0], False
                assert reward == 0.0 and not ends
            else:
                alone, own, terminated, truncated, _ = env.step(actions[k, i])
                done = terminated or truncated
                assert own == reward and done == ends
            assert (alone == seen).all()


@pytest.mark.slow
def test_vehicles_of_one_batch_share_the_kept_starts(monkeypatch):
    flown = []
    plain = Episodes._begin

    def count(episodes, i, seed):
        if seed % 2 not in episodes._kept:
            flown.append(seed)
        plain(episodes, i, seed)

    monkeypatch.setattr(Episodes, "_begin", count)
    env, alone = make_vec(6, starts=2), make(starts=2)

    seen = env.reset(seed=0)[0]

    assert sorted(flown) == [0, 1]
    for i in range(6):
        assert (seen[i] == alone.reset(seed=i)[0]).all()
    env.close()


def test_it_is_pickled_and_refuses_to_draw_by_the_error_that_trainers_catch():
    with pytest.raises(TypeError, match="'rgb_array'"):
        tombo.gym.CollisionEnv(render_mode="rgb_array")
    env = make(scenario="pole", disturbances=True).unwrapped
    again = pickle.loads(pickle.dumps(env))
    assert again.episodes.scenario == env.episodes.scenario != make().unwrapped.episodes.scenario


@pytest.mark.slow
@pytest.mark.parametrize(
    ("use", "named"),
    [
        (lambda: make(scenario="nowhere"), "scenario"),
        (lambda: make(starts=0), "starts"),
        (lambda: make(scenario="hover", duration=3.0).reset(seed=0), "without a collision"),
        (lambda: make_vec(0), "num_envs"),
        (lambda: make_vec(2).reset(seed=[1]), "seed"),
        (lambda: tombo.gym.CollisionEnv().step(np.zeros(5)), "action"),
    ],
)
def test_bad_arguments_are_refused_by_name(use, named):
    with pytest.raises(tombo.InputError, match=named):
        use()

"""The reaction of a trained policy: its observation, the effect of its action, its file."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from tombo_collision.decision import Estimate
from tombo_collision.network import answer, network_text, read_network
from tombo_collision.reactions.policy import Policy
from tombo_collision.steering import ACCELERATION, ACTIONS, HIGH, REACH
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.messages import CollisionEvent, Trigger

X_C = np.array([1.7, 0.3, 2.0])
PUSH = np.array([-0.6, -0.8, 0.0])
EVENT = CollisionEvent(
    stamp_ns=23_100_000_000,
    frame_id=FRAME_MAP,
    trigger=Trigger.IMU,
    contact_stamp_ns=23_096_000_000,
    contact_position=X_C,
    flight_direction=np.array([1.0, 0.0, 0.0]),
    confidence=1.0,
    statistic=100.0,
    count=1,
    rotor=2,
    push=PUSH,
)
TURN = np.array([0.0, 0.0, math.sin(0.2), math.cos(0.2)])


def decided(network=None):
    still = Estimate(X_C, np.zeros(3), TURN, np.zeros(3))
    return Policy(network=network).begin(EVENT, still, None)


def constant(action):
    """A network of one layer that answers `action` to everything."""
    layer = np.zeros((ACTIONS, HIGH.size + 1))
    layer[:, -1] = np.arctanh(action)
    return read_network("network", [layer.tolist()])


def test_without_a_network_it_rests_at_x_r():
    decision = decided()
    at = Estimate(X_C + 0.1, np.ones(3), TURN, np.zeros(3))
    asked = decision.reference(0.3, at)
    assert asked.position == pytest.approx(X_C + 0.8 * PUSH)
    assert not asked.velocity.any() and not asked.acceleration.any()
    assert asked.yaw == pytest.approx(0.4)


def test_an_action_is_along_n_r_to_its_left_and_up():
    action = np.array([0.5, 0.0, 0.2, 0.0, -0.4, 0.6])
    asked = decided(constant(action)).reference(0.1, Estimate(X_C, PUSH, TURN, PUSH))
    left, up = np.array([0.8, -0.6, 0.0]), np.array([0.0, 0.0, 1.0])
    goal = X_C + 0.8 * PUSH + REACH * (0.5 * PUSH + 0.2 * up)
    assert asked.position == pytest.approx(goal)
    assert asked.acceleration == pytest.approx(ACCELERATION * (-0.4 * left + 0.6 * up))


def test_it_sees_the_same_whichever_way_the_world_is_turned():
    """A quarter turn of the whole scene about map z changes nothing."""

    def turned(v):
        return np.array([-v[1], v[0], v[2]])

    velocity, rates = np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, 3.0])
    seen = decided().observation(0.5, Estimate(X_C + 0.2, velocity, TURN, rates))
    around = CollisionEvent(
        **{**vars(EVENT), "contact_position": turned(X_C), "push": turned(PUSH)}
    )
    q = np.array([0.0, 0.0, math.sin(0.2 + math.pi / 4), math.cos(0.2 + math.pi / 4)])
    other = Policy().begin(around, Estimate(turned(X_C), np.zeros(3), q, np.zeros(3)), None)
    there = Estimate(turned(X_C + 0.2), turned(velocity), q, rates)
    assert other.observation(0.5, there) == pytest.approx(seen, abs=1e-6)
    assert seen[:3] == pytest.approx([-0.28, 0.04, 0.2], abs=1e-6)
    assert seen[15:].tolist() == [1.0, 2.0, 3.0, 0.5, 0.0, 0.0, 1.0, 0.0]


def test_a_file_gives_the_network_that_was_written(tmp_path):
    rng = np.random.default_rng(0)
    layers = [rng.normal(size=(5, HIGH.size + 1)), rng.normal(size=(ACTIONS, 6))]
    path = tmp_path / "policy.json"
    path.write_text(network_text(layers))
    read = read_network("network", str(path))
    assert read == read_network("network", read)  # as a scenario holds it
    x = rng.normal(size=HIGH.size).astype(np.float32)
    hidden = np.tanh(layers[0] @ np.append(x, 1.0).astype(float))
    assert answer(read, x) == pytest.approx(np.tanh(layers[1] @ np.append(hidden, 1.0)))


ROW = [0.0] * (HIGH.size + 1)


@pytest.mark.parametrize(
    "layers",
    [
        *(3, [], [[]], [[ROW[1:]] * ACTIONS], [[ROW] * (ACTIONS - 1)], {"layers": []}),
        *([[[*ROW[1:], "a"]] * ACTIONS], [[[*ROW[1:], math.nan]] * ACTIONS], [[ROW] * 300]),
        [[[*ROW[1:], 10**400]] * ACTIONS],
    ],
)
def test_what_is_no_network_is_refused(tmp_path, layers):
    path = tmp_path / "policy.json"
    path.write_text(json.dumps(layers))
    for value in (layers, str(path)):
        with pytest.raises(InputError, match=r"reaction\.network.*accepted"):
            read_network("reaction.network", value)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\x00"])
def test_a_file_that_is_no_json_is_refused(tmp_path, text):
    path = tmp_path / "policy.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"network.*accepted"):
        read_network("network", str(path))
    with pytest.raises(InputError, match="can't be read"):
        read_network("network", str(tmp_path / "none.json"))

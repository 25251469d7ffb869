"""Disturbances: each pushes as its physics says, and none pushes unless it is set."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_vehicle import Vehicle, hover_speed, random_attitude
from scipy.spatial.transform import Rotation

from tombo_benchmarks.diagnosis.disturbances import DISTURBANCES, set_disturbance

every_shape = pytest.mark.parametrize("name", DISTURBANCES)
SEEDS = st.integers(0, 1000)


def disturbed(name, *values, **where):
    v = Vehicle(**where)
    set_disturbance(v.plant, name, *values)
    return v


def added(name, *values, ticks=0, **where):
    """Return the wrench that the disturbance adds at the start of a tick, in body axes."""
    wrenches = []
    for v in (Vehicle(**where), disturbed(name, *values, **where)):
        v.plant.ticks = ticks
        v.begin()
        wrenches.append(v.wrench.copy())
    return wrenches[1] - wrenches[0]


# --- all of them ----------------------------------------------------------------------------


@every_shape
def test_typical_disturbance_shows_and_stays_finite(name):
    ends = []
    for v in (Vehicle(speed=hover_speed()), disturbed(name, speed=hover_speed())):
        v.plant.state.velocity = [1.0, 0.5, 0.2]
        v.fly(1.0, lambda k: hover_speed() + 30.0 * math.sin(0.01 * k))
        ends.append(v.body.copy())
    assert np.isfinite(ends[1]).all()
    assert np.abs(ends[1] - ends[0]).max() > 1e-3


# --- one by one -----------------------------------------------------------------------------


@given(SEEDS)
def test_dry_drag_is_as_large_at_any_speed_and_always_brakes(seed):
    rng = np.random.default_rng(seed)
    attitude = random_attitude(rng)
    turn = Rotation.from_quat(attitude)
    across = np.append(rng.normal(0.0, 1.0, 2), 0.0)
    across /= np.linalg.norm(across)
    for speed in (0.5, 2.0, 8.0):
        velocity = turn.apply(speed * across + [0.0, 0.0, 1.0])
        drag = added("dry_drag", 0.6, attitude=attitude, velocity=velocity)[:3]
        assert drag == pytest.approx(-0.6 * across, abs=0.005)
    assert not added("dry_drag", 0.6, attitude=attitude).any()  # at rest


def test_thrust_goes_round_a_loop():
    """Rising, thrust lacks the play, falling it has it in excess; it is constant between them."""
    v = disturbed("thrust_hysteresis", 0.4)
    loop = {}
    levels = np.concatenate([np.linspace(300, 600, 200), np.linspace(600, 300, 200)])
    for k, speed in enumerate(levels):
        v.spin_up(speed)
        v.begin()
        loop.setdefault(round(speed), {})["up" if k < 200 else "down"] = (
            v.plant.force[2] - v.plant.rotors[0].thrust
        )
        v.finish()
    both = [g for g in loop.values() if len(g) == 2]
    middle = both[len(both) // 2]
    assert middle["up"] == pytest.approx(-0.4, abs=1e-9)
    assert middle["down"] == pytest.approx(0.4, abs=1e-9)

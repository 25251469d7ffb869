"""Disturbances: each pushes as its physics says, and none pushes unless it is set."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_vehicle import Vehicle, hover_speed, random_attitude, vacuum_maps
from scipy.spatial.transform import Rotation

from tombo_dynamics.disturbance import DISTURBANCES, set_disturbance
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY

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
def test_it_is_no_candidate_and_says_what_it_is(name):
    assert name not in REGISTRY
    shape = DISTURBANCES[name]
    assert shape.doc.endswith(".") and shape.params
    for p in shape.params:
        low, high = p.bounds
        assert p.unit and p.doc and low <= p.typical <= high
    assert len({s.id for s in DISTURBANCES.values()}) == len(DISTURBANCES)


@every_shape
def test_with_typical_values_it_shows_and_stays_finite(name):
    ends = []
    for v in (Vehicle(speed=hover_speed()), disturbed(name, speed=hover_speed())):
        v.plant.state.velocity = [1.0, 0.5, 0.2]
        v.fly(1.0, lambda k: hover_speed() + 30.0 * math.sin(0.01 * k))
        ends.append(v.body.copy())
    assert np.isfinite(ends[1]).all()
    assert np.abs(ends[1] - ends[0]).max() > 1e-3


def test_without_one_nothing_is_kept_or_changed():
    v = Vehicle(speed=hover_speed(), velocity=(1.0, 0.0, 0.0))
    v.fly(0.05)
    assert v.plant.disturbance == np.zeros((), v.plant.disturbance.dtype)


@every_shape
def test_it_can_be_exchanged_and_leaves_nothing_behind(name):
    v = disturbed(name)
    v.fly(0.01)
    set_disturbance(v.plant, "body_push", 0.0, 0.0, 0.0)
    kept = v.plant.disturbance.copy()
    kept.kind = 0
    assert kept == np.zeros((), kept.dtype)


def test_what_cannot_be_set_is_refused():
    v = Vehicle()
    with pytest.raises(InputError, match=r"'tethr' \(did you mean 'tether'\?\)"):
        set_disturbance(v.plant, "tethr")
    with pytest.raises(InputError, match=r"'dry_drag': 2 parameters; accepted: force \[N\]"):
        set_disturbance(v.plant, "dry_drag", 1.0, 2.0)
    with pytest.raises(InputError, match=r"disturbance\.dry_drag\.force: -1"):
        set_disturbance(v.plant, "dry_drag", -1.0)
    assert v.plant.disturbance == np.zeros((), v.plant.disturbance.dtype)


# --- one by one -----------------------------------------------------------------------------


def test_a_tether_is_slack_up_to_its_length_and_then_pulls():
    anchor = (1.0, 2.0, 0.0)
    slack = added("tether", *anchor, 5.0, 10.0, position=(1.0, 2.0, 4.9))
    assert not slack.any()
    attitude = Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    taut = added(
        "tether", *anchor, 1.0, 10.0, position=(4.0, 6.0, 12.0), attitude=attitude.as_quat()
    )
    towards = np.array([-3.0, -4.0, -12.0]) / 13.0
    assert attitude.apply(taut[:3]) == pytest.approx(10.0 * 12.0 * towards)
    assert not taut[3:].any()


def test_a_tether_keeps_energy(no_air):
    v = disturbed(
        "tether", 0.0, 0.0, 20.0, 1.0, 30.0, maps=no_air, position=(2.0, 0.0, 20.0),
        velocity=(0.0, 2.0, 0.0),
    )  # fmt: skip

    def energy(v):
        stretch = max(np.linalg.norm(v.position - [0.0, 0.0, 20.0]) - 1.0, 0.0)
        return v.energy() + 0.5 * 30.0 * stretch**2

    energies = v.fly(5.0, watch=energy)
    assert np.ptp(energies) < 1e-6 * energies[0]


def test_a_load_hangs_with_its_weight():
    """In a hover that carries both, the pull is the load's weight, straight down."""
    load = 0.2
    v = disturbed("slung_load", load, 0.5, speed=hover_speed())
    thrust = (v.mass + load) * GRAVITY
    speed = hover_speed() * math.sqrt(thrust / (v.mass * GRAVITY))
    v.spin_up(speed)
    v.fly(1.0)
    assert v.plant.disturbance.pull == pytest.approx(
        [0.0, 0.0, -load * GRAVITY], rel=0.02, abs=1e-9
    )
    assert v.plant.force[2] == pytest.approx(v.mass * GRAVITY, rel=0.02)


def test_a_load_swings_with_the_period_of_a_pendulum(no_air):
    """Below a vehicle that is held in place."""
    length = 1.0
    v = disturbed("slung_load", 0.1, length, maps=no_air, position=(0.0, 0.0, 50.0))
    v.plant.disturbance.load_position = [
        length * math.sin(0.1),
        0.0,
        50.0 - length * math.cos(0.1),
    ]
    sideways = []
    for _ in range(6000):
        v.body = [0.0, 0.0, 50.0, *[0.0] * 6, 1.0, 0.0, 0.0, 0.0]
        v.begin()
        sideways.append(v.plant.disturbance.load_position[0])
        v.finish()
    x = np.array(sideways)
    up = np.flatnonzero((x[1:] >= 0.0) & (x[:-1] < 0.0)) * 1e-3
    period = 2.0 * math.pi * math.sqrt(length / GRAVITY) * (1.0 + 0.1**2 / 16.0)
    assert np.diff(up) == pytest.approx(period, rel=0.005)
    assert np.abs(x[-2100:]).max() > 0.08  # the cord takes little of the swing


@pytest.mark.slow
@given(SEEDS)
def test_vehicle_and_load_keep_their_momentum(seed):
    rng = np.random.default_rng(seed)
    v = disturbed(
        "slung_load", 0.4, 0.6, maps=vacuum_maps(), position=(0.0, 0.0, 100.0),
        velocity=rng.normal(0.0, 1.0, 3), attitude=random_attitude(rng), rates=rng.normal(0, 1, 3),
    )  # fmt: skip
    load = v.plant.disturbance
    load.load_position += rng.normal(0.0, 0.1, 3)
    load.load_velocity += rng.normal(0.0, 0.5, 3)

    def momentum():
        return v.mass * v.velocity + 0.4 * load.load_velocity

    before = momentum()
    v.fly(0.5)
    fallen = np.array([0.0, 0.0, -(v.mass + 0.4) * GRAVITY * 0.5])
    assert momentum() == pytest.approx(before + fallen, abs=1e-9)
    reach = np.linalg.norm(load.load_position - v.position)
    assert reach < 0.6 * 1.1


def test_a_load_lies_on_the_floor_until_the_cord_is_taut():
    v = disturbed("slung_load", 0.2, 0.7, position=(0.0, 0.0, 0.18))
    v.plant.state.velocity = [0.0, 0.0, 0.0]
    load = v.plant.disturbance.load_position
    for height in (0.3, 0.69):
        v.plant.state.position[2] = height
        v.plant.state.velocity = 0.0
        v.begin()
        assert load[2] == 0.0 and not v.plant.disturbance.pull.any()
    v.plant.state.position[2] = 0.72
    v.begin()
    assert v.plant.disturbance.pull[2] < 0.0


def test_a_load_that_falls_stays_where_it_hits_the_floor():
    v = disturbed("slung_load", 0.2, 0.7, position=(0.0, 0.0, 0.4))
    load = v.plant.disturbance
    load.load_position, load.load_velocity = [0.1, 0.0, 0.1], [0.3, 0.0, 0.0]
    for _ in range(300):
        v.plant.state.position, v.plant.state.velocity = [0.0, 0.0, 0.4], 0.0
        v.begin()
        v.finish()
    fall = math.sqrt(2.0 * 0.1 / GRAVITY)
    assert load.load_position == pytest.approx([0.1 + 0.3 * fall, 0.0, 0.0], abs=1e-3)
    assert load.load_velocity == pytest.approx(np.zeros(3), abs=1e-3)
    assert load.load_position[2] == 0.0


def test_a_periodic_push_goes_to_and_fro_along_its_heading():
    heading = 0.7
    attitude = Rotation.from_euler("z", 0.4)
    for ticks, size in ((0, 0.0), (125, 2.0), (250, 0.0), (375, -2.0)):
        push = added("periodic_push", 2.0, 2.0, heading, ticks=ticks, attitude=attitude.as_quat())
        expected = size * np.array([math.cos(heading), math.sin(heading), 0.0])
        assert attitude.apply(push[:3]) == pytest.approx(expected, abs=1e-9)
        assert not push[3:].any()


def test_a_periodic_push_over_whole_periods_gives_no_momentum(no_air):
    v = disturbed("periodic_push", 3.0, 5.0, 0.0, maps=no_air)
    v.fly(1.0)
    assert v.velocity[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert v.position[0] == pytest.approx(3.0 / v.mass / (2.0 * math.pi * 5.0) * 1.0, rel=1e-3)


def test_thrust_fades_with_the_time_since_the_start():
    whole = added("body_push", 0.0, 0.0, 0.0, speed=hover_speed())
    assert not whole.any()
    v = Vehicle(speed=hover_speed())
    v.begin()
    thrust = v.plant.force[2]
    for seconds, lost in ((0.0, 0.0), (10.0, 0.05), (20.0, 0.1), (1000.0, 0.8)):
        fade = added("thrust_fade", 0.005, ticks=1000 * seconds, speed=hover_speed())
        assert fade == pytest.approx([0.0, 0.0, -lost * thrust, 0.0, 0.0, 0.0])


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


def test_a_body_push_turns_with_the_vehicle():
    for heading in (0.0, 2.0):
        attitude = Rotation.from_euler("z", heading).as_quat()
        push = added("body_push", 0.5, -0.3, 0.1, attitude=attitude)
        assert push == pytest.approx([0.5, -0.3, 0.1, 0.0, 0.0, 0.0])


def test_a_wall_draws_in_and_less_with_the_distance():
    heading = 0.5 * math.pi  # a wall at y = 3
    at_wall = added("wall_suction", 2.0, 0.4, 3.0, heading, position=(5.0, 3.0, 1.0))
    away = added("wall_suction", 2.0, 0.4, 3.0, heading, position=(-7.0, 2.2, 1.0))
    assert at_wall[:3] == pytest.approx([0.0, 2.0, 0.0], abs=1e-12)
    assert away[:3] == pytest.approx([0.0, 2.0 * math.exp(-2.0), 0.0], abs=1e-12)


def test_a_cable_turns_back_to_its_heading():
    for heading, share in ((0.3, 0.0), (0.3 + 0.5 * math.pi, -1.0), (0.3 - 0.5 * math.pi, 1.0)):
        attitude = Rotation.from_euler("z", heading).as_quat()
        moment = added("yaw_spring", 0.05, 0.3, attitude=attitude)
        assert moment == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 0.05 * share], abs=1e-12)


def test_thrust_goes_round_a_loop():
    """Rising, thrust lacks the play, falling it has it in excess; between there is no change."""
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

"""The mission: its phases in order, escape and hold, landing."""

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest
from mission_bench import HOME, Follower

from tombo_control.planning.leg import leg_position
from tombo_control.planning.mission import (
    MissionParams,
    advance_mission,
    compiled_plan,
    start_reaction,
)
from tombo_dynamics.messages import Phase

PLAN = MissionParams()
STEP = 1.0 / 30.0
STILL = np.zeros(3)


def advanced(state, now, position, velocity=STILL):
    """The state one step on, by the default plan."""
    state = copy.deepcopy(state)
    advance_mission(state, compiled_plan(PLAN), now, position, velocity)
    return state


def collided():
    """A flight that has been told to leave for x_r in its approach."""
    flight = Follower(PLAN).run(23.0)
    start_reaction(flight.state, flight.position - [0.8, 0.0, 0.0], flight.now)
    return flight


def test_goes_on_only_when_the_climb_has_come_to_rest():
    flight = Follower(PLAN).run(PLAN.takeoff_time + 1.0)
    late = flight.state.leg.end_s + 1.0
    top = np.array(leg_position(flight.state.leg, late))
    low, fast = top - [0.0, 0.0, 0.1], np.array([0.0, 0.0, 0.2])
    assert advanced(flight.state, late, low).mode == Phase.TAKEOFF
    assert advanced(flight.state, late, top, fast).mode == Phase.TAKEOFF
    assert advanced(flight.state, late, top).mode == Phase.HOVER


@pytest.mark.parametrize(
    ("offset", "velocity"),
    [((0.11, 0.0, 0.0), (0.0, 0.0, 0.0)), ((0.0, 0.0, 0.0), (0.0, 0.11, 0.0))],
)
def test_settled_means_near_and_slow_for_a_whole_second(offset, velocity):
    state = collided().state
    there = np.array(state.leg.start)
    disturbed_at = 23.0 + 0.9
    for now in np.arange(23.1, 25.5, STEP):
        bad = abs(now - disturbed_at) < 0.5 * STEP
        position = there + offset if bad else there
        state = advanced(state, now, position, np.array(velocity) if bad else STILL)
        settled = now > disturbed_at + 1.0 + 0.5 * STEP
        assert state.mode == (Phase.HOLD if settled else Phase.REACT)


@pytest.mark.parametrize(
    ("lag", "speed", "height"), [(0.1, 0.0, 0.18), (0.3, 0.3, 0.18), (0.3, 0.0, 1.0)]
)
def test_landed_means_held_up_by_the_floor(lag, speed, height):
    """Not while it follows the reference, still moves, or is held up far above the floor."""
    flight = collided().run(60.0, Phase.LAND)
    state = flight.state
    now = next(
        t
        for t in itertools.count(flight.now, 0.001)
        if leg_position(state.leg, t)[2] <= height - lag
    )
    at = np.array([*leg_position(state.leg, now)[:2], height])
    assert advanced(state, now, at, np.array([0.0, 0.0, -speed])).mode == Phase.LAND
    on_the_floor = np.array([at[0], at[1], 0.18])
    low = next(
        t for t in itertools.count(flight.now, 0.001) if leg_position(state.leg, t)[2] <= -0.12
    )
    landed = advanced(state, low, on_the_floor)
    assert landed.mode == Phase.LANDED
    assert advanced(landed, low + 10.0, on_the_floor).mode == Phase.LANDED


def test_steps_go_round_a_square_with_changes_of_height():
    plan = replace(PLAN, step_size=1.5, step_period=2.5, approach_time=10.0, land_time=35.0)
    flight = Follower(plan)
    corners = []
    for t in np.arange(10.5, 34.0, plan.step_period):
        flight.run(t)
        corners.append(flight.position - [*HOME[:2], plan.height])
    assert flight.state.mode == Phase.APPROACH
    assert len(corners) == 10
    assert np.allclose(corners[0], [1.5, 0.0, 0.0])
    assert np.allclose(corners[4], corners[0])
    jumps = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    assert (jumps >= 1.5).all()
    assert np.ptp(np.array(corners)[:, 2]) > 0.5

"""The mission as its node flies it: its clock, waiting, starts in flight, whatever stops."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_collision.reactions.bounce import Bounce
from tombo_control.autopilot import (
    APPROACH,
    HOLD,
    HOVER,
    IDLE,
    LAND,
    LANDED,
    REACT,
    TAKEOFF,
)
from tombo_control.mission import MissionParams, advance_mission, begin, compiled_plan
from tombo_control.mission_core import (
    BLIND,
    NO_ESTIMATE,
    REACTING,
    REACTION_BLIND,
    REACTION_HOLDING,
    REACTION_HOLDS,
    REACTION_IDLE,
    REACTION_SILENT,
    TWO_ESTIMATES,
    MissionCore,
    MissionLimits,
)
from tombo_dynamics.vehicle import VehicleParams

MS = 1_000_000
START = 1_763_700_000_000_000_000
PLAN = MissionParams(approach_time=8.0, land_time=20.0, hold_time=2.0)
LIMITS = MissionLimits()
HOME = np.array([0.1, -0.2, 0.18])
NOWHERE = (math.nan,) * 3
X_R = np.array([0.5, 0.1, 2.0])


def setpoint_of(outputs):
    return next((m for topic, m in outputs if topic == "/mission/setpoint"), None)


class World:
    """A vehicle that follows the set point with a lag of 0.1 s, and the course, at 50 Hz."""

    def __init__(self, place=HOME, plan=PLAN, started=True, epoch=START):
        self.course = MissionCore(plan, LIMITS, started)
        self.place = np.array(place, float)
        self.velocity = np.zeros(3)
        self.now = epoch
        self.odometry = self.answers = True
        self.follows = True
        self.said = []
        self.modes = []

    def reaction(self, state, x_r=NOWHERE, count=0, age_s=0.0):
        stamp = self.now - round(1e9 * age_s)
        self.course.reaction(state, np.array(x_r, dtype=float), count, stamp, self.now)

    def run(self, seconds, stop=lambda world: False):
        for _ in range(round(seconds * 50)):
            self.now += 20 * MS
            if self.odometry:
                self.course.estimate(self.place.copy(), self.velocity.copy(), self.now)
            if self.answers:
                self.course.reaction_alive(self.now)
            said = setpoint_of(self.course.step(self.now))
            if said is not None:
                self.said.append(said)
                if not self.modes or said.phase != self.modes[-1]:
                    self.modes.append(said.phase)
                self.follow(said)
            if stop(self):
                break
        return self

    def follow(self, said):
        before = self.place
        if self.follows and said.phase not in (IDLE, LANDED):
            self.place = before + 0.2 * (said.position - before) + 0.02 * said.velocity * 0.8
        self.place = np.maximum(self.place, [-math.inf, -math.inf, HOME[2]])
        self.velocity = (self.place - before) / 0.02

    def until(self, mode, patience=60.0):
        self.run(patience, lambda world: world.course.mode == mode)
        assert self.course.mode == mode
        return self

    def largest_step(self, since=0):
        places = np.array([s.position for s in self.said[since:]])
        return np.linalg.norm(np.diff(places, axis=0), axis=1).max(initial=0.0)


def test_the_defaults_are_those_of_the_vehicle_and_the_reaction():
    assert MissionLimits().ground_height == VehicleParams().leg_height
    assert MissionLimits().escape_age == Bounce().timeout


def test_flies_the_plan_in_the_plan_s_own_time():
    world = World()
    began = world.now + 20 * MS
    when = {}
    for mode in (TAKEOFF, HOVER, APPROACH, LAND, LANDED):
        when[mode] = (world.until(mode).now - began) * 1e-9
    assert world.modes == [IDLE, TAKEOFF, HOVER, APPROACH, LAND, LANDED]
    assert when[TAKEOFF] == pytest.approx(PLAN.takeoff_time, abs=0.021)
    assert when[APPROACH] == pytest.approx(PLAN.approach_time, abs=0.021)
    assert when[LAND] == pytest.approx(PLAN.land_time, abs=0.021)
    assert world.course.time_s == pytest.approx(when[LANDED], abs=0.021)


def test_is_the_plan_of_the_headless_flight():
    """Step by step the same mode and reference, for the same estimates."""
    world = World()
    state = begin(HOME)
    for _ in range(1300):
        here, velocity = world.place.copy(), world.velocity.copy()
        world.run(0.02)
        now = world.course.time_s
        if state.mode == IDLE:
            state = begin(here)
        state = advance_mission(state, compiled_plan(PLAN), now, here, velocity)
        assert world.said[-1].phase == state.mode
        assert world.said[-1].position == pytest.approx(state.leg.position(now), abs=1e-9)
    assert state.mode == LANDED


def test_set_points_carry_the_reference_s_own_velocity_and_acceleration():
    world = World().until(LAND)
    place = np.array([s.position for s in world.said])
    velocity = np.array([s.velocity for s in world.said])
    acceleration = np.array([s.acceleration for s in world.said])
    moved = np.diff(place, axis=0) / 0.02
    mean = 0.5 * (velocity[1:] + velocity[:-1])
    same = np.array([a.phase == b.phase for a, b in zip(world.said, world.said[1:], strict=False)])
    assert np.abs(moved - mean)[same].max() < 0.01
    assert np.linalg.norm(velocity, axis=1).max() == pytest.approx(PLAN.approach_speed)
    assert np.linalg.norm(acceleration, axis=1).max() == pytest.approx(0.8)
    steps = np.diff(velocity, axis=0)[same] / 0.02
    assert np.abs(steps - 0.5 * (acceleration[1:] + acceleration[:-1])[same]).max() < 0.41
    assert all(s.stamp_ns for s in world.said)


def test_no_setpoint_before_the_first_estimate_which_starts_the_clock():
    world = World()
    world.odometry = False
    world.run(5.0)
    assert not world.said
    world.odometry = True
    world.run(0.9)
    assert world.course.mode == IDLE
    world.run(0.2)
    assert world.course.mode == TAKEOFF


def test_home_is_where_it_stands_when_it_takes_off():
    world = World()
    world.run(0.5)
    world.place = HOME + np.array([0.3, 0.2, 0.0])
    world.until(HOVER)
    assert world.said[-1].position == pytest.approx([0.4, 0.0, PLAN.height])


def test_waits_for_the_word_to_start():
    world = World(started=False)
    world.run(30.0)
    assert world.modes == [IDLE]
    world.course.set_params("auto_start", True)
    world.run(PLAN.takeoff_time + 0.05)
    assert world.course.mode == TAKEOFF


@pytest.mark.parametrize("plan", [PLAN, replace(PLAN, takeoff_time=0.0)])
def test_takes_off_only_when_told(plan):
    assert World(plan=plan, started=False).run(3.0).modes == [IDLE]


def test_follows_the_reaction_to_x_r_holds_and_lands():
    world = World().until(APPROACH)
    world.run(1.5)
    world.reaction(REACTING, X_R, 1)
    world.run(0.02)
    assert world.said[-1].phase == REACT
    assert world.said[-1].position == pytest.approx(X_R)
    world.until(HOLD)
    held = world.now
    world.until(LAND)
    assert (world.now - held) * 1e-9 == pytest.approx(PLAN.hold_time, abs=0.03)
    world.until(LANDED)
    assert world.place[:2] == pytest.approx(X_R[:2], abs=0.02)


def test_the_same_decision_again_changes_nothing_a_new_one_does():
    world = World().until(APPROACH)
    world.reaction(REACTING, X_R, 1)
    world.until(HOLD)
    world.reaction(REACTION_BLIND, X_R, 1)
    world.reaction(REACTING, X_R, 1)
    world.run(0.1)
    assert world.course.mode == HOLD
    second = X_R + np.array([0.0, -0.8, 0.0])
    world.reaction(REACTION_BLIND, second, 2)  # decided while blind: as good
    world.run(0.02)
    assert world.course.mode == REACT
    assert world.said[-1].position == pytest.approx(second)


@pytest.mark.parametrize("mode", [IDLE, LAND, LANDED])
def test_on_the_ground_and_landing_it_does_not_follow(mode):
    world = World() if mode == IDLE else World().until(mode)
    world.run(0.1)
    world.reaction(REACTING, X_R, 1)
    world.run(0.1)
    assert world.course.mode == mode


def test_a_decision_without_a_place_or_of_long_ago_is_none():
    world = World().until(APPROACH)
    world.reaction(REACTING, (0.5, math.nan, 2.0), 1)
    world.reaction(REACTING, X_R, 1, age_s=LIMITS.escape_age + 0.1)
    world.run(0.1)
    assert world.course.mode == APPROACH


@pytest.mark.parametrize(
    ("state", "why"),
    [(REACTION_HOLDING, REACTION_HOLDS), (REACTION_BLIND, BLIND), (None, REACTION_SILENT)],
)
@pytest.mark.parametrize("mode", [TAKEOFF, HOVER, APPROACH])
def test_it_waits_at_the_vehicle_while_the_reaction_holds(state, why, mode):
    world = World().until(mode).run(1.2)
    assert not world.course.wait_reason
    if state is None:
        world.answers = False
        world.run(0.32)
    else:
        world.reaction(state)
    world.follows = False
    world.run(1.0)
    assert world.course.wait_reason == why
    world.place = world.place + np.array([-0.6, 0.3, 0.1])  # held elsewhere, drifted
    world.run(1.0)
    assert math.dist(world.said[-1].position, world.place) < 0.06
    assert not world.said[-1].velocity.any()
    assert world.said[-1].phase == mode
    # and on from there
    again = len(world.said) - 1
    world.follows = world.answers = True
    world.reaction(REACTION_IDLE)
    world.run(0.1)
    assert not world.course.wait_reason
    assert world.largest_step(again) < 0.02
    world.run(6.0)
    assert world.largest_step(again) < 0.02
    assert world.course.mode == APPROACH


def test_waiting_does_not_put_off_the_landing():
    world = World().until(APPROACH)
    world.reaction(REACTION_HOLDING)
    world.until(LAND)
    assert world.course.time_s == pytest.approx(PLAN.land_time, abs=0.03)


def test_does_not_take_off_while_the_reaction_holds():
    world = World()
    world.run(0.1)
    world.reaction(REACTION_HOLDING)
    world.run(5.0)
    assert world.modes == [IDLE]
    world.reaction(REACTION_IDLE)
    world.run(0.1)
    assert world.modes == [IDLE, TAKEOFF]
    assert world.largest_step() < 0.02


def test_a_reaction_that_has_never_spoken_is_not_waited_for():
    world = World()
    world.answers = False
    world.until(HOVER)


@pytest.mark.parametrize("mode", [TAKEOFF, APPROACH, REACT, LAND])
def test_without_estimates_the_reference_and_the_clock_stand_still(mode):
    world = World()
    if mode == REACT:
        world.until(APPROACH)
        world.reaction(REACTING, X_R, 1)
    world.until(mode).run(0.7)
    world.odometry = False
    world.run(0.28)
    begin, time_s = len(world.said), world.course.time_s
    assert world.course.wait_reason == NO_ESTIMATE
    world.run(30.0)
    assert world.course.time_s == time_s
    assert world.largest_step(begin) == 0.0
    assert not np.any([s.velocity for s in world.said[begin:]])
    assert not np.any([s.acceleration for s in world.said[begin:]])
    assert world.course.mode == mode
    world.odometry = True
    world.run(3.0)
    assert world.largest_step(begin) < 0.1


@pytest.mark.parametrize("drift", [(0.0, 0.1, -0.2), (0.0, 1.0, -0.5)])
def test_after_drift_without_estimates_it_resumes_from_the_vehicle(drift):
    world = World().until(APPROACH).run(1.0)
    world.odometry = False
    world.run(1.0)
    world.place = world.place + np.array(drift)
    world.odometry = True
    world.follows = False
    world.run(0.02)
    assert math.dist(world.said[-1].position, world.place) < 0.01
    assert world.course.mode == APPROACH


def test_two_estimators_stop_it_as_none_does():
    world = World().until(APPROACH)
    world.course.set_multiple_publishers("/odometry", True)
    begin = len(world.said)
    world.run(3.0)
    assert world.course.wait_reason == TWO_ESTIMATES
    assert world.largest_step(begin) == 0.0
    world.course.set_multiple_publishers("/odometry", False)
    world.run(0.1)
    assert not world.course.wait_reason


def test_a_vehicle_left_behind_is_not_left_behind_for_ever():
    world = World().until(APPROACH)
    world.follows = False
    world.run(6.0)
    assert math.dist(world.said[-1].position, world.place) < LIMITS.lag_max + 0.02
    assert max(math.dist(s.position, world.place) for s in world.said[-300:]) > 0.3


def test_hovering_off_the_spot_is_no_lag():
    world = World().until(HOVER)
    world.follows = False
    world.place = world.place + np.array([0.8, 0.0, 0.0])
    world.run(1.0)
    assert world.said[-1].position == pytest.approx([*HOME[:2], PLAN.height])


def test_begun_in_flight_it_holds_and_lands():
    place = np.array([1.3, 0.4, 1.7])
    world = World(place)
    world.run(0.02)
    assert world.said[0].phase == HOLD
    assert world.said[0].position == pytest.approx(place)
    world.until(LAND)
    assert world.course.time_s == pytest.approx(PLAN.hold_time, abs=0.03)
    world.until(LANDED)
    assert world.place == pytest.approx([1.3, 0.4, 0.18], abs=0.02)


@pytest.mark.parametrize("before", [True, False])
def test_begun_in_flight_after_a_collision_it_goes_to_x_r(before):
    world = World(np.array([1.3, 0.4, 1.7]))
    if not before:
        world.run(0.5)
    world.reaction(REACTING, X_R, 1, age_s=3.0)
    world.run(0.04)
    assert world.modes[-1] == REACT
    assert world.said[-1].position == pytest.approx(X_R)
    world.until(LANDED)


def test_a_collision_of_the_flight_before_is_not_fled_from():
    """Latched, but followed by: idle again."""
    world = World(np.array([1.3, 0.4, 1.7]))
    world.reaction(REACTING, X_R, 1, age_s=3.0)
    world.reaction(REACTION_IDLE)
    world.run(0.5)
    assert world.modes == [HOLD]


def test_found_on_the_ground_the_flight_is_over():
    for mode in (HOVER, APPROACH, HOLD):
        world = World().until(APPROACH if mode == HOLD else mode)
        if mode == HOLD:
            world.reaction(REACTING, X_R, 1)
            world.until(HOLD)
        world.place = np.array([0.0, 0.0, 0.18])
        world.follows = False
        world.run(0.9)
        assert world.course.mode == mode
        world.until(LANDED, 0.3)
        world.run(10.0)
        assert world.course.mode == LANDED


def test_a_vehicle_that_does_not_lift_off_is_given_up():
    world = World().until(TAKEOFF)
    world.follows = False
    world.run(8.9)  # PX4 takes its time
    assert world.course.mode == TAKEOFF
    world.until(LANDED, 0.3)


def test_held_on_the_ground_it_is_not_given_up():
    world = World().until(TAKEOFF)
    world.reaction(REACTION_HOLDING)
    world.run(10.0)
    assert world.course.mode == TAKEOFF
    world.reaction(REACTION_IDLE)
    world.until(HOVER, 8.0)


def test_passing_low_is_not_standing():
    world = World().until(APPROACH)
    world.reaction(REACTING, X_R, 1)
    world.run(0.1)
    world.follows = False
    for _ in range(60):
        world.place = np.array([1.0, 0.0, 0.25])
        world.run(0.02)
        world.velocity = np.array([0.0, 0.0, 0.3])
    assert world.course.mode == REACT


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_estimate_that_is_no_number_is_refused(value):
    world = World().until(HOVER)
    assert not world.course.estimate(np.array([0.0, value, 2.0]), np.zeros(3), world.now)
    assert not world.course.estimate(np.zeros(3), np.array([0.0, 0.0, value]), world.now)
    world.run(1.0)
    assert world.course.mode == HOVER


@pytest.mark.parametrize("stopped_ms", [600, 3000])
def test_a_node_that_was_stopped_goes_on_without_a_jump(stopped_ms):
    world = World().until(APPROACH).run(1.0)
    begin = len(world.said) - 1
    world.now += stopped_ms * MS
    world.run(2.0)
    assert world.largest_step(begin) < 0.1


def test_a_clock_set_back_begins_a_new_flight():
    world = World().until(APPROACH)
    world.now = START - 10**12
    world.place = HOME.copy()
    world.run(0.1)
    assert world.course.mode == IDLE
    assert world.course.time_s < 0.2
    world.until(LANDED)


def test_a_plan_with_steps_goes_on_with_the_step_it_was_on():
    plan = replace(PLAN, step_size=1.0, step_period=4.0)
    world = World(plan=plan).until(APPROACH).run(2.0)
    corner = world.said[-1].position
    world.reaction(REACTION_HOLDING)
    world.follows = False
    world.place = world.place - np.array([0.5, 0.0, 0.0])
    world.run(0.5)
    world.follows = True
    world.reaction(REACTION_IDLE)
    world.run(1.4)
    assert world.said[-1].position == pytest.approx(corner, abs=0.05)
    assert world.course.mode == APPROACH


changes = st.lists(
    st.tuples(
        st.sampled_from(["estimates", "answers", "follows", "hold", "hit", "crowd"]),
        st.floats(0.02, 3.0),
    ),
    max_size=12,
)


@pytest.mark.slow
@settings(max_examples=40)
@given(changes)
def test_whatever_fails_set_points_are_finite_and_the_flight_ends(events):
    world = World().until(HOVER)
    held = crowd = False
    count = 0
    for kind, seconds in events:
        if kind == "estimates":
            world.odometry = not world.odometry
        elif kind == "answers":
            world.answers = not world.answers
        elif kind == "follows":
            world.follows = not world.follows
        elif kind == "hold":
            held = not held
            world.reaction(REACTION_HOLDING if held else REACTION_IDLE)
        elif kind == "hit":
            count += 1
            world.reaction(REACTING, X_R + 0.1 * count, count)
        else:
            crowd = not crowd
            world.course.set_multiple_publishers("/odometry", crowd)
        world.run(seconds)
    assert all(s.finite() for s in world.said)
    speeds = [float(np.linalg.norm(s.velocity)) for s in world.said]
    assert max(speeds) <= PLAN.approach_speed + 1e-9
    world.odometry = world.answers = world.follows = True
    world.course.set_multiple_publishers("/odometry", False)
    world.until(LANDED)

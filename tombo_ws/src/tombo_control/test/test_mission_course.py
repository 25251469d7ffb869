"""The mission as its node flies it: its clock, waiting, starts in flight, whatever stops."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission_bench import HOME, MS, PLAN, START, World

from tombo_collision.reactions.bounce import Bounce
from tombo_control.planning.course import read_course
from tombo_control.planning.mission_memory import MissionLimits, WaitReason
from tombo_dynamics.messages import Phase, ReactionPhase, is_finite
from tombo_dynamics.vehicle import VehicleParams

LIMITS = MissionLimits()
COURSE = read_course("c", [{"x": 1.5, "yaw": 1.5, "hold": 0.5}, {"y": 1.0, "speed": 2.0}])
X_R = np.array([0.5, 0.1, 2.0])


def test_the_defaults_are_those_of_the_vehicle_and_the_reaction():
    assert MissionLimits().ground_height == VehicleParams().leg_height
    assert MissionLimits().escape_age == Bounce().timeout


def test_flies_the_plan_in_the_plan_s_own_time():
    world = World()
    began = world.now + 20 * MS
    when = {}
    for mode in (Phase.TAKEOFF, Phase.HOVER, Phase.APPROACH, Phase.LAND, Phase.LANDED):
        when[mode] = (world.until(mode).now - began) * 1e-9
    assert world.modes == [*list(Phase)[:4], Phase.LAND, Phase.LANDED]
    assert when[Phase.TAKEOFF] == pytest.approx(PLAN.takeoff_time, abs=0.021)
    assert when[Phase.APPROACH] == pytest.approx(PLAN.approach_time, abs=0.021)
    assert when[Phase.LAND] == pytest.approx(PLAN.land_time, abs=0.021)
    assert world.course.time_s == pytest.approx(when[Phase.LANDED], abs=0.021)


def test_set_points_carry_the_reference_s_own_velocity_and_acceleration():
    world = World().until(Phase.LAND)
    place = np.array([s.position for s in world.setpoints])
    velocity = np.array([s.velocity for s in world.setpoints])
    acceleration = np.array([s.acceleration for s in world.setpoints])
    moved = np.diff(place, axis=0) / 0.02
    mean = 0.5 * (velocity[1:] + velocity[:-1])
    phase = np.array([s.phase for s in world.setpoints])
    same = phase[1:] == phase[:-1]
    assert np.abs(moved - mean)[same].max() < 0.01
    assert np.linalg.norm(velocity, axis=1).max() == pytest.approx(PLAN.approach_speed)
    assert np.linalg.norm(acceleration, axis=1).max() == pytest.approx(0.8)
    steps = np.diff(velocity, axis=0)[same] / 0.02
    assert np.abs(steps - 0.5 * (acceleration[1:] + acceleration[:-1])[same]).max() < 0.41
    assert all(s.stamp_ns for s in world.setpoints)


def test_no_setpoint_before_the_first_estimate_which_starts_the_clock():
    world = World()
    world.odometry = False
    world.run(5.0)
    assert not world.setpoints
    world.odometry = True
    world.run(0.9)
    assert world.course.mode == Phase.IDLE
    world.run(0.2)
    assert world.course.mode == Phase.TAKEOFF


@pytest.mark.parametrize("plan", [PLAN, replace(PLAN, takeoff_time=0.0)])
def test_takes_off_only_when_told(plan):
    world = World(plan=plan, started=False)
    world.run(30.0)
    assert world.modes == [Phase.IDLE]
    assert world.setpoints[-1].takeoff_commands == 0
    world.course.set_params("auto_start", True)
    world.run(plan.takeoff_time + 0.05)
    assert world.course.mode == Phase.TAKEOFF
    assert world.setpoints[-1].takeoff_commands == 1


def test_follows_the_reaction_to_x_r_holds_and_lands():
    world = World().until(Phase.APPROACH)
    world.run(1.5)
    world.reaction(ReactionPhase.REACTING, X_R, 1)
    world.run(0.02)
    assert world.setpoints[-1].phase == Phase.REACT
    assert world.setpoints[-1].position == pytest.approx(X_R)
    world.until(Phase.HOLD)
    held = world.now
    world.until(Phase.LAND)
    assert (world.now - held) * 1e-9 == pytest.approx(PLAN.hold_time, abs=0.03)
    world.until(Phase.LANDED)
    assert world.place[:2] == pytest.approx(X_R[:2], abs=0.02)


def test_the_same_decision_again_changes_nothing_a_new_one_does():
    world = World().until(Phase.APPROACH)
    world.reaction(ReactionPhase.REACTING, X_R, 1)
    world.until(Phase.HOLD)
    world.reaction(ReactionPhase.BLIND, X_R, 1)
    world.reaction(ReactionPhase.REACTING, X_R, 1)
    world.run(0.1)
    assert world.course.mode == Phase.HOLD
    second = X_R + np.array([0.0, -0.8, 0.0])
    world.reaction(ReactionPhase.BLIND, second, 2)  # decided while blind: as good
    world.run(0.02)
    assert world.course.mode == Phase.REACT
    assert world.setpoints[-1].position == pytest.approx(second)


@pytest.mark.parametrize("mode", [Phase.IDLE, Phase.LAND, Phase.LANDED])
def test_on_the_ground_and_landing_it_does_not_follow(mode):
    world = World() if mode == Phase.IDLE else World().until(mode)
    world.run(0.1)
    world.reaction(ReactionPhase.REACTING, X_R, 1)
    world.run(0.1)
    assert world.course.mode == mode


def test_a_decision_without_a_place_or_of_long_ago_is_none():
    world = World().until(Phase.APPROACH)
    world.reaction(ReactionPhase.REACTING, (0.5, math.nan, 2.0), 1)
    world.reaction(ReactionPhase.REACTING, X_R, 1, age_s=LIMITS.escape_age + 0.1)
    world.run(0.1)
    assert world.course.mode == Phase.APPROACH


@pytest.mark.parametrize(
    ("state", "why"),
    [
        (ReactionPhase.HOLDING, WaitReason.REACTION_HOLDS),
        (ReactionPhase.BLIND, WaitReason.BLIND),
        (None, WaitReason.REACTION_SILENT),
    ],
)
@pytest.mark.parametrize("mode", [Phase.TAKEOFF, Phase.APPROACH])
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
    assert math.dist(world.setpoints[-1].position, world.place) < 0.06
    assert not world.setpoints[-1].velocity.any()
    assert world.setpoints[-1].phase == mode
    # and on from there
    again = len(world.setpoints) - 1
    world.follows = world.answers = True
    world.reaction(ReactionPhase.IDLE)
    world.run(0.1)
    assert not world.course.wait_reason
    assert world.largest_step(again) < 0.02
    world.run(6.0)
    assert world.largest_step(again) < 0.02
    assert world.course.mode == Phase.APPROACH
    world.reaction(ReactionPhase.HOLDING)
    world.until(Phase.LAND)
    assert world.course.time_s == pytest.approx(PLAN.land_time, abs=0.03), "it is not put off"


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        *((mode, WaitReason.ESTIMATE_SILENT)
          for mode in (Phase.TAKEOFF, Phase.APPROACH, Phase.REACT, Phase.LAND)),
        (Phase.APPROACH, WaitReason.TWO_ESTIMATORS),
    ],
)  # fmt: skip
def test_without_one_source_of_estimates_reference_and_clock_stand_still(mode, why):
    world = World()
    if mode == Phase.REACT:
        world.until(Phase.APPROACH)
        world.reaction(ReactionPhase.REACTING, X_R, 1)
    world.until(mode).run(0.7)
    world.odometry = why != WaitReason.ESTIMATE_SILENT
    world.course.set_multiple_publishers("/odometry", world.odometry)
    world.run(0.28)
    begin, time_s = len(world.setpoints), world.course.time_s
    assert world.course.wait_reason == why
    world.run(30.0)
    assert world.course.time_s == time_s
    assert world.largest_step(begin) == 0.0
    assert not np.any([(s.velocity, s.acceleration) for s in world.setpoints[begin:]])
    assert world.course.mode == mode
    world.odometry = True
    world.course.set_multiple_publishers("/odometry", False)
    world.run(3.0)
    assert not world.course.wait_reason
    assert world.largest_step(begin) < 0.1


def test_a_vehicle_left_behind_is_not_left_behind_for_ever():
    world = World().until(Phase.APPROACH)
    world.follows = False
    world.run(6.0)
    assert math.dist(world.setpoints[-1].position, world.place) < LIMITS.lag_max + 0.02
    assert max(math.dist(s.position, world.place) for s in world.setpoints[-300:]) > 0.3


def test_begun_in_flight_it_holds_and_lands():
    place = np.array([1.3, 0.4, 1.7])
    world = World(place)
    world.run(0.02)
    assert world.setpoints[0].phase == Phase.HOLD
    assert world.setpoints[0].position == pytest.approx(place)
    world.until(Phase.LAND)
    assert world.course.time_s == pytest.approx(PLAN.hold_time, abs=0.03)
    world.until(Phase.LANDED)
    assert world.place == pytest.approx([1.3, 0.4, 0.18], abs=0.02)


@pytest.mark.parametrize("before", [True, False])
def test_begun_in_flight_after_a_collision_it_goes_to_x_r(before):
    world = World(np.array([1.3, 0.4, 1.7]))
    if not before:
        world.run(0.5)
    world.reaction(ReactionPhase.REACTING, X_R, 1, age_s=3.0)
    world.run(0.04)
    assert world.modes[-1] == Phase.REACT
    assert world.setpoints[-1].position == pytest.approx(X_R)
    world.until(Phase.LANDED)


def test_found_on_the_ground_the_flight_is_over():
    for mode in (Phase.HOVER, Phase.APPROACH, Phase.HOLD):
        world = World().until(Phase.APPROACH if mode == Phase.HOLD else mode)
        if mode == Phase.HOLD:
            world.reaction(ReactionPhase.REACTING, X_R, 1)
            world.until(Phase.HOLD)
        world.place = np.array([0.0, 0.0, 0.18])
        world.follows = False
        world.run(0.9)
        assert world.course.mode == mode
        world.until(Phase.LANDED, 0.3)
        world.run(10.0)
        assert world.course.mode == Phase.LANDED


def test_a_vehicle_that_does_not_lift_off_is_given_up():
    world = World().until(Phase.TAKEOFF)
    world.follows = False
    world.run(8.9)  # PX4 takes its time
    assert world.course.mode == Phase.TAKEOFF
    world.until(Phase.LANDED, 0.3)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_estimate_that_is_no_number_is_refused(value):
    world = World().until(Phase.HOVER)
    assert not world.course.estimate(np.array([0.0, value, 2.0]), np.zeros(3), world.now)
    assert not world.course.estimate(np.zeros(3), np.array([0.0, 0.0, value]), world.now)
    world.run(1.0)
    assert world.course.mode == Phase.HOVER


def test_a_node_that_was_stopped_goes_on_without_a_jump():
    world = World().until(Phase.APPROACH).run(1.0)
    begin = len(world.setpoints) - 1
    world.now += 3000 * MS
    world.run(2.0)
    assert world.largest_step(begin) < 0.1


def test_a_clock_set_back_begins_a_new_flight():
    world = World().until(Phase.APPROACH)
    world.now = START - 10**12
    world.place = HOME.copy()
    world.run(0.1)
    assert world.course.mode == Phase.IDLE
    world.run(5.0)
    assert world.course.mode == Phase.IDLE, "it takes a command"
    assert world.course.time_s == 0.0
    assert world.course.command("takeoff") == ""
    world.until(Phase.LANDED)


@pytest.mark.parametrize("held", [True, False])
def test_a_vehicle_that_was_put_down_takes_off_again(held):
    """PX4 has landed it, or its rotors were stopped: the plan still believes to fly."""
    world = World().until(Phase.APPROACH)
    if held:
        assert world.course.command("hold") == ""
    world.run(0.1)
    before = world.course.memory.takeoff_commands
    world.velocity = np.zeros(3)
    world.place, world.follows = HOME.copy(), False
    world.run(0.5)
    assert world.course.mode == Phase.APPROACH
    assert world.course.command("takeoff") == ""
    assert world.course.memory.takeoff_commands == before + 1
    world.run(0.1)
    assert world.course.mode == Phase.IDLE, "the bridge sees it on the ground"
    world.follows = True
    world.until(Phase.APPROACH)


def test_an_operator_holds_lands_and_takes_off_again():
    world = World().until(Phase.APPROACH)
    assert world.course.command("takeoff") == "it flies: phase approach"
    assert world.course.command("hold") == ""
    world.run(2.0)
    held = world.setpoints[-1].position
    world.run(3.0)
    assert world.course.mode == Phase.APPROACH
    assert world.setpoints[-1].position == pytest.approx(held, abs=0.06)
    assert world.course.command("takeoff") == "", "it goes on"
    world.run(1.5)
    assert np.linalg.norm(world.setpoints[-1].position - held) > 0.1
    assert world.course.command("land") == ""
    world.until(Phase.LANDED).run(5.0)
    assert world.course.mode == Phase.LANDED
    assert world.course.command("hold") == "nothing to hold: phase landed"
    begin = len(world.setpoints)
    assert world.course.command("takeoff") == ""
    world.until(Phase.HOVER)
    phases = [s.phase for s in world.setpoints[begin:]]
    assert phases.index(Phase.IDLE) < phases.index(Phase.TAKEOFF)
    commands = [s.takeoff_commands for s in world.setpoints]
    assert set(commands[:begin]) == {0}, "the first flight began by itself"
    assert set(commands[begin:]) == {1}


def test_told_to_land_on_the_ground_it_does_not_take_off():
    world = World().run(0.2)
    assert world.course.mode == Phase.IDLE
    assert world.course.command("abort") == ""
    world.run(5.0)
    assert world.course.mode == Phase.IDLE


changes = st.lists(
    st.tuples(
        st.sampled_from(["estimates", "answers", "follows", "hold", "hit", "crowd"]),
        st.floats(0.02, 3.0),
    ),
    max_size=12,
)


@pytest.mark.slow
@settings(max_examples=20)
@given(changes)
def test_whatever_fails_set_points_are_finite_and_the_flight_ends(events):
    world = World().until(Phase.HOVER)
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
            world.reaction(ReactionPhase.HOLDING if held else ReactionPhase.IDLE)
        elif kind == "hit":
            count += 1
            world.reaction(ReactionPhase.REACTING, X_R + 0.1 * count, count)
        else:
            crowd = not crowd
            world.course.set_multiple_publishers("/odometry", crowd)
        world.run(seconds)
    assert all(is_finite(s) for s in world.setpoints)
    speeds = [float(np.linalg.norm(s.velocity)) for s in world.setpoints]
    assert max(speeds) <= PLAN.approach_speed + 1e-9
    world.odometry = world.answers = world.follows = True
    world.course.set_multiple_publishers("/odometry", False)
    world.until(Phase.LANDED)

"""Goals and courses commanded in flight: flown, refused, watched, ended."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mission_bench import World

from core_calls import reported
from tombo_control.planning.commanded_course import CourseProgress
from tombo_control.planning.mission import MissionParams
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase, Pose, ReactionPhase

PLAN = MissionParams(approach_time=8.0, land_time=60.0)


def pose(x=0.0, y=0.0, z=0.0, yaw=0.0, frame="map", norm=1.0):
    attitude = norm * np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)])
    return Pose(0, frame, np.array([x, y, z], float), attitude)


@pytest.fixture
def hovering():
    return World(plan=PLAN).until(Phase.HOVER).run(0.5)


def test_a_goal_is_flown_to_at_the_plan_s_speed_and_held_in_place_of_the_plan(hovering):
    world = hovering
    height = world.setpoints[-1].position[2]
    assert not reported(world.course, "/goal_pose", pose(1.5, -1.0, yaw=-3.0), world.now)
    world.run(40.0)
    assert world.place == pytest.approx([1.5, -1.0, height], abs=0.02)
    assert math.remainder(world.setpoints[-1].yaw + 3.0, math.tau) == pytest.approx(0.0, abs=1e-9)
    speed = [np.linalg.norm(setpoint.velocity) for setpoint in world.setpoints]
    assert max(speed) == pytest.approx(PLAN.approach_speed)
    assert world.largest_step() < 0.021 * PLAN.approach_speed
    assert world.course.mode == Phase.APPROACH
    world.until(Phase.LANDED)  # at land_time, from there
    assert world.place[:2] == pytest.approx([1.5, -1.0], abs=0.05)


@pytest.mark.parametrize(
    ("goal", "text"),
    [
        (pose(frame="base_link"), "frame 'base_link'; accepted: map"),
        (pose(x=math.nan), "NaN or infinity"),
        (pose(y=math.inf), "NaN or infinity"),
        (pose(norm=0.5), "no rotation"),
        (pose(norm=math.nan), "NaN"),
        (pose(x=2000.0), "goal_pose[0].x"),
        (pose(z=-1.0), "goal_pose[0].z"),
        (pose(z=51.0), "goal_pose[0].z"),
    ],
)
def test_a_goal_that_can_t_be_flown_to_changes_nothing(hovering, goal, text):
    before = hovering.setpoints[-1].position
    hovering.course.health.take_events()
    hovering.course.on("/goal_pose", goal, hovering.now)
    ((key, refusal),) = hovering.course.health.take_events()
    assert key == "goal_refused"
    assert text in refusal
    hovering.run(1.0)
    assert hovering.course.mode == Phase.HOVER
    assert hovering.setpoints[-1].position == pytest.approx(before)


def test_goals_are_taken_in_the_air_only_and_not_in_a_reaction():
    world = World(plan=PLAN)
    for phase in (Phase.IDLE, Phase.TAKEOFF, Phase.REACT, Phase.LAND, Phase.LANDED):
        if phase == Phase.REACT:
            world.until(Phase.APPROACH).reaction(ReactionPhase.REACTING, (0.5, 0.1, 2.0), 1)
        if phase != Phase.IDLE:
            world.until(phase)
        with pytest.raises(InputError, match="accepted: hover, approach, hold"):
            world.course.fly_course("waypoints", [pose(1.0)])
        assert world.course.course_progress is None


def test_a_course_tells_leg_distance_and_time_and_keeps_to_them(hovering):
    world, course = hovering, hovering.course
    x, y, z = world.setpoints[-1].position
    course.fly_course(
        "waypoints", [pose(x + 1.0, y, z), pose(x + 1.0, y + 2.0, z)], speed=0.5, hold=1.0
    )
    world.run(0.02)
    begin: CourseProgress = course.course_progress
    assert (begin.leg, begin.legs, begin.arrived) == (1, 2, False)
    assert begin.distance == pytest.approx(3.0, abs=0.01)
    ramp = 0.5 / 0.8
    assert begin.time_left == pytest.approx(1.0 / 0.5 + 2.0 / 0.5 + 2 * ramp + 1.0, abs=0.05)
    began, progress = world.now, []
    world.run(30.0, lambda w: progress.append(course.course_progress) or progress[-1].arrived)
    assert (world.now - began) * 1e-9 == pytest.approx(begin.time_left, abs=0.5)
    assert [f.leg for f in progress] == sorted(f.leg for f in progress)
    assert np.diff([f.distance for f in progress]).max() < 1e-9
    assert np.diff([f.time_left for f in progress]) == pytest.approx(-0.02, abs=0.011)
    assert progress[-1].distance == pytest.approx(0.0, abs=1e-9)


def test_a_course_that_is_ended_holds_there(hovering):
    world, course = hovering, hovering.course
    course.fly_course("waypoints", [pose(4.0, 0.0, 2.0)])
    world.run(2.0)
    there, since = world.setpoints[-1].position, len(world.setpoints) - 1
    course.hold_course()
    world.run(5.0)
    assert world.setpoints[-1].position == pytest.approx(there, abs=0.02)
    assert world.largest_step(since) < 0.02
    assert world.course.mode == Phase.APPROACH


def test_a_reaction_ends_a_course_and_what_follows_is_the_plan_s(hovering):
    world = hovering
    world.course.fly_course("waypoints", [pose(4.0, 0.0, 2.0), pose(4.0, 3.0, 2.0)])
    world.run(1.0)
    world.reaction(ReactionPhase.REACTING, (0.5, 0.1, 2.0), 1)
    world.run(0.1)
    assert world.course.mode == Phase.REACT
    assert world.course.course_progress is None
    world.until(Phase.LANDED)
    assert world.place[:2] == pytest.approx([0.5, 0.1], abs=0.05)

"""Goals commanded in flight: flown, refused, ended."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mission_bench import World

from core_calls import reported
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
            world.course.fly_to_goal(pose(1.0))


def test_a_newer_goal_and_a_reaction_end_the_way_to_a_goal(hovering):
    world = hovering
    world.course.on("/goal_pose", pose(4.0, 0.0, 2.0), world.now)
    world.run(1.0)
    world.course.on("/goal_pose", pose(0.0, 4.0, 2.0), world.now)
    since = len(world.setpoints) - 1
    world.run(2.0)
    assert world.largest_step(since) < 0.02
    assert world.place[1] > 0.5 > world.place[0]
    world.reaction(ReactionPhase.REACTING, (0.5, 0.1, 2.0), 1)
    world.run(0.1)
    assert world.course.mode == Phase.REACT
    world.until(Phase.LANDED)
    assert world.place[:2] == pytest.approx([0.5, 0.1], abs=0.05)

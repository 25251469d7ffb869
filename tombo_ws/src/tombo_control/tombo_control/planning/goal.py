"""A goal that somebody commands in flight: a place and a heading in map, then a hold."""

from __future__ import annotations

import math
from typing import Any

from tombo_control.planning.course import read_course, waypoint_table
from tombo_control.planning.leg import hold_leg, leg_position, leg_yaw
from tombo_control.planning.mission import MissionParams, MissionState, Plan, compiled_plan
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP, is_map
from tombo_dynamics.input_check import check_pose
from tombo_dynamics.messages import PHASE_NAMES, Phase, Pose
from tombo_dynamics.rotation import yaw_of

_HOLD_S = 1e9
"""At the goal: until something else is commanded, or it is time to land."""
_FLIES_FROM = (Phase.HOVER, Phase.APPROACH, Phase.HOLD)


def fly_to(
    goal: Pose, state: MissionState, now_s: float, speed: float
) -> tuple[MissionState, Array]:
    """Return the state at the begin of the way to a goal, at rest, and its waypoint (1, 8).

    Args:
        goal: place and heading in map; a height of 0, which RViz's arrow gives, keeps the present
            one. The turn is the shorter one.
        state: where the mission stands.
        now_s: flight time.
        speed: on the way [m/s].

    Raises:
        InputError: not in this phase; or not in map, NaN, no rotation, or out of the bounds of a
            waypoint.
    """
    if state.mode not in _FLIES_FROM:
        accepted = ", ".join(PHASE_NAMES[phase] for phase in _FLIES_FROM)
        raise InputError(f"goal_pose: phase {PHASE_NAMES[state.mode]}; accepted: {accepted}")
    if not is_map(goal.frame_id):
        raise InputError(f"goal_pose: frame '{goal.frame_id:.60}'; accepted: {FRAME_MAP}")
    why = check_pose(0, 0, math.inf, goal.position, goal.attitude)
    if why:
        raise InputError(f"goal_pose: {why.text}; accepted: numbers and a unit quaternion")
    here, heading = leg_position(state.leg, now_s), leg_yaw(state.leg, now_s)
    x, y, z = (float(value) for value in goal.position)
    yaw = heading + math.remainder(yaw_of(goal.attitude) - heading, math.tau)
    waypoint = {"x": x, "y": y, "z": z or here[2], "yaw": yaw, "speed": speed}
    course = read_course("goal_pose", [waypoint])
    assert isinstance(course, tuple)
    table = waypoint_table(course)
    table[-1, -1] = _HOLD_S
    return MissionState(Phase.APPROACH.value, hold_leg(here, now_s, heading), state.home), table


def plan_with(params: MissionParams, course: Array, began_s: float) -> Plan:
    """Return the plan that flies to a goal in place of its own course, from `began_s` on."""
    plan: Any = compiled_plan(params).params
    plan.approach_time = began_s
    return Plan(plan, course)

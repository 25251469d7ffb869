"""A course that somebody commands in flight: places in map, one after the other, then a hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tombo_control.planning.course import (
    Waypoint,
    leg_to,
    read_course,
    resolved_waypoint,
    waypoint_table,
)
from tombo_control.planning.leg import Point, leg_position, leg_yaw, motion_end
from tombo_control.planning.mission import MissionParams, MissionState, Plan, compiled_plan, wait
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP, is_map
from tombo_dynamics.input_check import check_pose
from tombo_dynamics.messages import PHASE_NAMES, Phase, Pose
from tombo_dynamics.rotation import yaw_of

_HOLD_S = 1e9
"""At the last place: until something else is commanded, or it is time to land."""
_ARRIVAL_DISTANCE = 0.2
"""m from the last place: the vehicle is there."""
_FLIES_FROM = (Phase.HOVER, Phase.APPROACH, Phase.HOLD)


@dataclass(frozen=True)
class CourseProgress:
    """How far a commanded course is.

    Attributes:
        leg: which one is flown, from 1.
        legs: how many there are.
        distance: way of the reference to the last place [m].
        time_left: until it is there [s].
        arrived: the reference is there, and the vehicle is near it.
    """

    leg: int
    legs: int
    distance: float
    time_left: float
    arrived: bool


def course_of(
    name: str, poses: Sequence[Pose], state: MissionState, now_s: float, speed: float, hold: float
) -> Array:
    """Return the waypoints (N, 8) of commanded poses, as `waypoint_table`.

    Args:
        name: what to call them in an error, as goal_pose.
        poses: places and headings in map; a height of 0, which RViz's arrow gives, keeps that of
            the pose before. Each turn is the shorter one.
        state: where the mission stands.
        now_s: flight time.
        speed: on each leg [m/s].
        hold: at each place but the last [s].

    Raises:
        InputError: not in this phase; not in map, NaN, no rotation, out of the bounds of a
            waypoint, or none at all.
    """
    _check_phase(state)
    _, _, z = leg_position(state.leg, now_s)
    yaw = leg_yaw(state.leg, now_s)
    waypoints = []
    for number, pose in enumerate(poses):
        each = name if len(poses) == 1 else f"{name}[{number}]"
        if not is_map(pose.frame_id):
            raise InputError(f"{each}: frame '{pose.frame_id:.60}'; accepted: {FRAME_MAP}")
        why = check_pose(0, 0, math.inf, pose.position, pose.attitude)
        if why:
            raise InputError(f"{each}: {why.text}; accepted: numbers and a unit quaternion")
        x, y, height = (float(value) for value in pose.position)
        z = height if height != 0.0 else z
        yaw += math.remainder(yaw_of(pose.attitude) - yaw, math.tau)
        waypoints.append({"x": x, "y": y, "z": z, "yaw": yaw, "speed": speed, "hold": hold})
    course = read_course(name, waypoints)
    assert isinstance(course, tuple)
    return _held_at_the_end(course)


def course_here(state: MissionState, now_s: float, speed: float) -> Array:
    """Return the course that ends where the reference is; raise InputError in another phase."""
    _check_phase(state)
    x, y, z = leg_position(state.leg, now_s)
    return _held_at_the_end([Waypoint(x, y, z, leg_yaw(state.leg, now_s), speed)])


def _held_at_the_end(course: Sequence[Waypoint]) -> Array:
    table = waypoint_table(course)
    table[-1, -1] = _HOLD_S
    return table


def _check_phase(state: MissionState) -> None:
    """Refuse a course in a phase that it can't begin in."""
    if state.mode not in _FLIES_FROM:
        accepted = ", ".join(PHASE_NAMES[phase] for phase in _FLIES_FROM)
        raise InputError(f"course in phase {PHASE_NAMES[state.mode]}; accepted: {accepted}")


def begin_course(state: MissionState, now_s: float) -> None:
    """Begin a commanded course: the reference rests where it is."""
    here = np.array(leg_position(state.leg, now_s))
    wait(state, Phase.APPROACH.value, now_s, here)
    state.steps = 0
    state.settled_since_s = math.inf
    state.settled_s = state.course_s = math.nan


def plan_with(params: MissionParams, course: Array, began_s: float) -> Plan:
    """Return the plan that flies a commanded course in place of its own, from `began_s` on."""
    plan: Any = compiled_plan(params).params
    plan.approach_time = began_s
    return Plan(plan, course)


def progress(state: MissionState, course: Array, now_s: float, position: Array) -> CourseProgress:
    """Return how far a course is; `position` (3) is the vehicle's, in map."""
    legs = len(course)
    here, yaw = leg_position(state.leg, now_s), leg_yaw(state.leg, now_s)
    distance = time_left = 0.0
    if state.steps:
        end_s = motion_end(state.leg)
        end = leg_position(state.leg, end_s)
        distance, time_left = math.dist(here, end), max(end_s - now_s, 0.0)
        if state.steps < legs:
            time_left = max(end_s + state.leg.hold_s - now_s, 0.0)
        here, yaw = end, leg_yaw(state.leg, end_s)
    for row in range(state.steps, legs):
        target = resolved_waypoint(course, row, here, 1.0)
        place: Point = (target.x, target.y, target.z)
        leg = leg_to(target, here, yaw, 0.0)
        distance += math.dist(here, place)
        time_left += motion_end(leg) + (leg.hold_s if row + 1 < legs else 0.0)
        here, yaw = place, target.yaw
    arrived = state.steps == legs and time_left == 0.0
    near = math.dist(here, (position[0], position[1], position[2])) < _ARRIVAL_DISTANCE
    return CourseProgress(max(int(state.steps), 1), legs, distance, time_left, arrived and near)

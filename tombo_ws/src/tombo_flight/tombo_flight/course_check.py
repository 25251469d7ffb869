"""Checks that a scenario allows its course: time, speed, no jumps beside it."""

from __future__ import annotations

import math

import numpy as np

from tombo_control.params import ControlParams
from tombo_control.planning.course import leg_to, resolved_waypoints
from tombo_control.planning.leg import Point, straight_leg
from tombo_control.planning.mission import MissionParams
from tombo_control.safety.flight_volume import outside_volume
from tombo_control.safety.params import FlightVolume
from tombo_dynamics.errors import InputError
from tombo_dynamics.records import parameter_record

_ROUNDING = 1.0 + 1e-9


def check_course(mission: MissionParams, control: ControlParams, volume: FlightVolume) -> None:
    """Refuse a course that could not be flown to its end as it is written.

    Args:
        mission: with the course, if any.
        control: its limits of velocity.
        volume: where the vehicle may fly.

    Raises:
        InputError: jumps are asked for as well, a leg is faster than the controller allows, it
            leaves the flight volume, or it is to land before the course is over.
    """
    if mission.height > volume.z_max:
        raise InputError(
            f"mission.height: {mission.height:g}; accepted: at most volume.z_max, {volume.z_max:g}"
        )
    if mission.course is None:
        return
    if mission.step_size > 0.0:
        raise InputError(
            f"mission.course and mission.step_size {mission.step_size:g}: accepted: one of them"
        )
    hover: Point = (0.0, 0.0, mission.height)
    end_s = course_begin(mission)
    here, yaw = hover, 0.0
    limits = parameter_record(volume)
    for i, target in enumerate(resolved_waypoints(mission.course, hover, mission.approach_speed)):
        leg = leg_to(target, here, yaw, end_s)
        vx, vy, vz = leg.velocity
        _check_speed(i, "across", math.hypot(vx, vy), "velocity_max_xy", control.velocity_max_xy)
        _check_speed(i, "up or down", abs(vz), "velocity_max_z", control.velocity_max_z)
        end_s, here, yaw = leg.hold_end_s, target[:3], target.yaw
        off = outside_volume(np.array(here), limits)
        if off > 0.0:
            raise InputError(
                f"mission.course[{i}]: {off:.2f} m outside of the flight volume; accepted: a "
                "waypoint inside (volume.*)"
            )
    if end_s > mission.land_time:
        raise InputError(
            f"mission.course: lasts until {end_s:.1f} s; accepted: at most mission.land_time, "
            f"{mission.land_time:g} (land later, or begin before mission.approach_time, "
            f"{mission.approach_time:g})"
        )


def course_begin(mission: MissionParams) -> float:
    """Return when the course begins if the climb goes well [s]."""
    climb = straight_leg(
        (0.0, 0.0, 0.0), (0.0, 0.0, mission.height), mission.climb_speed, mission.takeoff_time
    )
    return max(mission.approach_time, climb.end_s)


def _check_speed(i: int, way: str, speed: float, name: str, limit: float) -> None:
    if speed > limit * _ROUNDING:
        raise InputError(
            f"mission.course[{i}].speed: {speed:.2f} m/s {way}; accepted: at most "
            f"control.{name}, {limit:g}"
        )

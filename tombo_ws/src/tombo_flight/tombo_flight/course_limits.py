"""Whether a course stays in the flight volume and within what the vehicle can do."""

from __future__ import annotations

import math

import numpy as np

from tombo_control.params import ControlParams
from tombo_control.planning.course import YAW_RATE, leg_to, resolved_waypoint, waypoint_table
from tombo_control.planning.leg import ACCELERATION, Point, motion_end, straight_leg, turning_leg
from tombo_control.planning.mission import MissionParams, compiled_plan
from tombo_control.planning.timed_course import piece_reference, read_timed_course, sampled_course
from tombo_control.safety.flight_volume import outside_volume
from tombo_control.safety.params import FlightVolume
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_rotors
from tombo_dynamics.records import parameter_record
from tombo_dynamics.vehicle import GRAVITY, VehicleParams

_STEP_S = 0.02
"""Time between two checked places: a period of the mission."""
_LOWEST = 0.3
"""[m]: lowest height of a reference, as of a waypoint."""
_ROUNDING = 1e-6
_SPEED_ROUNDING = 1.0 + 1e-9
"""Factor on the limit of a leg's speed."""


def check_course(
    mission: MissionParams,
    control: ControlParams,
    volume: FlightVolume,
    vehicle: VehicleParams,
    propeller: PropellerChoice,
) -> None:
    """Refuse a course that could not be flown to its end as it is written.

    Args:
        mission: with the course, if any.
        control: its limits of velocity.
        volume: where the vehicle may fly.
        vehicle: with the propeller.
        propeller: as mounted.

    Raises:
        InputError: jumps are enabled as well; a leg is faster than the controller allows; it
        leaves the flight volume; it lands before the course ends; or as `_check_timed_course`.
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
    end_s = _course_begin(mission)
    here, yaw = hover, 0.0
    limits = parameter_record(volume)
    course = mission.course
    if isinstance(course, str):
        end_s, course = _timed_course_end(mission, end_s), ()
    table = waypoint_table(course)
    for i in range(len(table)):
        target = resolved_waypoint(table, i, hover, mission.approach_speed)
        leg = leg_to(target, here, yaw, end_s)
        vx, vy, vz = leg.velocity
        _check_speed(i, "across", math.hypot(vx, vy), "velocity_max_xy", control.velocity_max_xy)
        _check_speed(i, "up or down", abs(vz), "velocity_max_z", control.velocity_max_z)
        end_s, here, yaw = motion_end(leg) + leg.hold_s, target[:3], target.yaw
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
    if isinstance(mission.course, str):
        _check_timed_course(mission.course, mission, control, volume, vehicle, propeller)


def _course_begin(mission: MissionParams) -> float:
    """Return when the course begins if the climb goes well [s]."""
    climb = straight_leg(
        (0.0, 0.0, 0.0), (0.0, 0.0, mission.height), mission.climb_speed, mission.takeoff_time
    )
    return max(mission.approach_time, climb.end_s)


def _check_speed(i: int, way: str, speed: float, name: str, limit: float) -> None:
    if speed > limit * _SPEED_ROUNDING:
        raise InputError(
            f"mission.course[{i}].speed: {speed:.2f} m/s {way}; accepted: at most "
            f"control.{name}, {limit:g}"
        )


def _timed_course_end(mission: MissionParams, begin_s: float) -> float:
    """Return when a timed course is over [s]; `begin_s`: the vehicle leaves the hover."""
    pieces = compiled_plan(mission).waypoints
    first = piece_reference(pieces, 0, 0.0)
    hover = (0.0, 0.0, mission.height)
    yaws, speed = (0.0, first.yaw), mission.approach_speed
    way = turning_leg(hover, first.position, yaws, begin_s, speed, ACCELERATION, YAW_RATE)
    return float(motion_end(way) + pieces[-1, 1])


def _check_timed_course(
    text: str,
    mission: MissionParams,
    control: ControlParams,
    volume: FlightVolume,
    vehicle: VehicleParams,
    propeller: PropellerChoice,
) -> None:
    """Refuse a timed course, the text of a file, that the vehicle could not follow.

    Raises:
        InputError: the course leaves the volume, is too low, or exceeds the vehicle's speed,
            acceleration or tilt; the error names row, time and value of the first violation.
    """
    rows = read_timed_course(text).rows
    piece, t, position, velocity, acceleration = sampled_course(
        compiled_plan(mission).waypoints, _STEP_S
    )
    box = parameter_record(volume)
    away = np.array([outside_volume(p, box) for p in position[:, :3]])
    thrust = acceleration[:, :3] + [0.0, 0.0, GRAVITY]
    across = np.hypot(thrust[:, 0], thrust[:, 1])
    strongest = 4.0 * mounted_rotors(propeller, vehicle).thrust_highest / vehicle.mass
    limits = (
        ("{:.3f} m outside of the flight volume", away, 0.0,
         "inside (volume.*)"),
        ("{:.2f} m too low", _LOWEST - position[:, 2], 0.0, f"z of at least {_LOWEST:g} m"),
        ("speed {:.2f} m/s across", np.hypot(velocity[:, 0], velocity[:, 1]),
         control.velocity_max_xy, "at most control.velocity_max_xy, {:g}"),
        ("speed {:.2f} m/s up or down", np.abs(velocity[:, 2]), control.velocity_max_z,
         "at most control.velocity_max_z, {:g}"),
        ("yaw rate {:.2f} rad/s", np.abs(velocity[:, 3]), control.yaw_rate_max,
         "at most control.yaw_rate_max, {:g}"),
        ("acceleration {:.2f} m/s^2 with gravity", np.linalg.norm(thrust, axis=1), strongest,
         "at most {:.4g}, which the rotors can give"),
        ("tilt {:.2f} rad", np.arctan2(across, thrust[:, 2]), control.tilt_max,
         "at most control.tilt_max, {:g}"),
    )  # fmt: skip
    found = []
    for what, values, limit, accepted in limits:
        beyond = np.flatnonzero(np.asarray(values) > limit + _ROUNDING)
        if beyond.size:
            i = int(beyond[0])
            found.append((i, what.format(values[i]), accepted.format(limit)))
    if found:
        i, what, accepted = min(found)
        raise InputError(
            f"mission.course: row {rows[piece[i]]}, at {t[i]:.2f} s: {what}; accepted: {accepted}"
        )

"""Whether a timed course stays in the flight volume and within what the vehicle can do."""

from __future__ import annotations

import numpy as np

from tombo_control.params import ControlParams
from tombo_control.planning.course import YAW_RATE
from tombo_control.planning.leg import ACCELERATION, motion_end, turning_leg
from tombo_control.planning.mission import MissionParams, compiled_plan
from tombo_control.planning.timed_course import piece_reference, read_timed_course, sampled_course
from tombo_control.safety.flight_volume import outside_volume
from tombo_control.safety.params import FlightVolume
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_rotors
from tombo_dynamics.records import parameter_record
from tombo_dynamics.vehicle import GRAVITY, VehicleParams

_STEP_S = 0.02
"""Between two checked places, a period of the mission."""
_LOWEST = 0.3
"""[m]: lowest height of a reference, as of a waypoint."""
_ROUNDING = 1e-6


def timed_course_end(mission: MissionParams, begin_s: float) -> float:
    """Return when a timed course is over [s]; `begin_s`: the vehicle leaves the hover."""
    pieces = compiled_plan(mission).waypoints
    first = piece_reference(pieces, 0, 0.0)
    hover = (0.0, 0.0, mission.height)
    yaws, speed = (0.0, first.yaw), mission.approach_speed
    way = turning_leg(hover, first.position, yaws, begin_s, speed, ACCELERATION, YAW_RATE)
    return float(motion_end(way) + pieces[-1, 1])


def check_timed_course(
    mission: MissionParams,
    control: ControlParams,
    volume: FlightVolume,
    vehicle: VehicleParams,
    propeller: PropellerChoice,
) -> None:
    """Refuse a timed course that the vehicle could not follow.

    Raises:
        InputError: names row, time and value of the first place that is outside of the volume or
            too low, or where speed, acceleration or tilt are beyond the vehicle's.
    """
    text = mission.course
    assert isinstance(text, str)
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

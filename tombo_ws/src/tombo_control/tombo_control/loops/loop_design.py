"""Gains for another vehicle: the cascade of the default vehicle, slowed to the other's drives.

The cascade commands accelerations and knows mass and inertia. Its loops then depend on the motors'
lag, the yaw drive, and the turn that a small error of thrust causes. `docs/control.md` states the
rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from tombo_control.params import ControlParams
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_rotors
from tombo_dynamics.rotor_maps import RotorMaps, rotor_thrust, rotor_torque, speed_for_thrust
from tombo_dynamics.vehicle import VehicleParams

_YAW_CROSSOVER = 13.0
"""rad/s: of the default vehicle's yaw rate loop (docs/control.md)."""
_MOST_INTEGRAL = 200.0
"""rad/s^2: the highest accepted `rate_i_max`."""


@dataclass(frozen=True)
class YawDrive:
    """How yaw torque follows the torque asked for, linear about hover."""

    gain: float
    """Steady torque over the torque asked for: the allocation takes drag as a share of thrust."""
    lead: float
    """Rotor inertia over the slope of drag torque with speed [s]: a rotor that is sped up
    reacts on the airframe long before its drag has grown."""


def yaw_drive(vehicle: VehicleParams, maps: RotorMaps) -> YawDrive:
    """Return the yaw actuator of a vehicle in hover, with the table `rotor_maps` of its rotors."""
    speed = float(speed_for_thrust(maps, vehicle.hover_thrust()))
    step = 1e-3 * speed
    thrust_slope = rotor_thrust(maps, speed + step) - rotor_thrust(maps, speed - step)
    torque_slope = rotor_torque(maps, speed + step) - rotor_torque(maps, speed - step)
    ratio = rotor_torque(maps, speed) / rotor_thrust(maps, speed)
    return YawDrive(
        gain=float(torque_slope / thrust_slope / ratio),
        lead=float(vehicle.rotor_inertia * 2.0 * step / torque_slope),
    )


def gains_for(vehicle: VehicleParams, maps: RotorMaps) -> ControlParams:
    """Return gains with which a vehicle flies as the default one does, only slower if it must.

    - Every crossover goes with 1 / motor lag, none above the default's: gains per time with that
      factor, integral gains with its square. Faster motors leave the gains and add margin.
    - The yaw rate loop crosses at the same share of its default crossover, whatever the rotors'
      inertia and drag torque.
    - The limit of the rate integral goes with the angular acceleration that an error of one
      percent of thrust makes.

    For the default vehicle they are the default gains.

    Args:
        vehicle: its motor lag, rotor inertia, inertia, arms and weight are used.
        maps: the table `tombo_dynamics.rotor_maps` of its rotors.
    """
    plain, like = ControlParams(), VehicleParams()
    slow = min(1.0, like.motor_time_constant / vehicle.motor_time_constant)
    like_maps = mounted_rotors(PropellerChoice(), like)
    yaw = _yaw_rate_gain(like, like_maps, 1.0) / _yaw_rate_gain(vehicle, maps, slow)
    turn = max(1.0, _turning(vehicle) / _turning(like))
    return replace(
        plain,
        position_p=plain.position_p * slow,
        velocity_p=plain.velocity_p * slow,
        velocity_i=plain.velocity_i * slow**2,
        attitude_p=plain.attitude_p * slow,
        yaw_p=plain.yaw_p * slow,
        rate_p=plain.rate_p * slow,
        rate_i=plain.rate_i * slow**2,
        yaw_rate_p=plain.yaw_rate_p * yaw,
        yaw_rate_i=plain.yaw_rate_i * yaw * slow,
        rate_i_max=min(plain.rate_i_max * turn, _MOST_INTEGRAL),
    )


def _yaw_rate_gain(vehicle: VehicleParams, maps: RotorMaps, slow: float) -> float:
    """Return the gain from yaw acceleration asked for to yaw rate at the loop's crossover [s]."""
    drive = yaw_drive(vehicle, maps)
    w = _YAW_CROSSOVER * slow
    lead, lag = math.hypot(1.0, drive.lead * w), math.hypot(1.0, vehicle.motor_time_constant * w)
    return drive.gain * lead / (lag * w)


def _turning(vehicle: VehicleParams) -> float:
    """Return the angular acceleration of a thrust difference of the whole weight [rad/s^2]."""
    return vehicle.hover_thrust() * vehicle.arm_length / vehicle.inertia_xx

"""Vehicle files and the airframes that logs name, each as the other."""

from __future__ import annotations

import math
from typing import Any

from tombo_bag.flight import Airframe
from tombo_dynamics.vehicle import AIR_DENSITY, GRAVITY
from tombo_flight.vehicle_file import FORMAT, VehicleFile, vehicle_from_mapping


def airframe_of(file: VehicleFile) -> Airframe:
    """Return the parameters of a vehicle that the logs need."""
    v = file.vehicle
    return Airframe(
        name=file.name,
        mass=v.mass,
        arm_length=v.arm_length,
        rotor_radius=v.rotor_radius,
        inertia=(v.inertia_xx, v.inertia_yy, v.inertia_zz),
        motor_time_constant=v.motor_time_constant,
    )


_THRUST_NUMBER = 0.015
"""Thrust over density, disc area and square of the tip speed; usual of small propellers: 0.0153 of
an APC SF 10x4.7 (UIUC propeller data), 0.021 of a Crazyflie's."""
_TORQUE_OVER_THRUST = 0.144
"""Drag torque over thrust and tip radius; 0.016 m at 9 inch."""


def vehicle_of(frame: Airframe, hover_speed: float | None = None) -> VehicleFile:
    """Return an airframe as a vehicle, with a propeller that carries it.

    Args:
        frame: the airframe.
        hover_speed: rotor speed that carries its weight [rad/s]; None: not known, the propeller is
            the usual one for its radius.

    Raises:
        InputError: values that no simulation takes.
    """
    k_thrust = _THRUST_NUMBER * AIR_DENSITY * math.pi * frame.rotor_radius**4
    guess = "estimated, because: usual for this radius"
    source = guess
    if hover_speed is not None:
        k_thrust = frame.mass * GRAVITY / 4.0 / hover_speed**2
        source = f"hovers at {hover_speed:.0f} rad/s"
    vehicle: dict[str, Any] = {"mass": frame.mass, "arm_length": frame.arm_length}
    if frame.inertia is not None:
        names = ("inertia_xx", "inertia_yy", "inertia_zz")
        vehicle |= dict(zip(names, frame.inertia, strict=True))
    vehicle["motor_time_constant"] = frame.motor_time_constant
    k_torque = _TORQUE_OVER_THRUST * frame.rotor_radius * k_thrust
    values = {
        "tombo_vehicle": FORMAT,
        "name": frame.name,
        "vehicle": vehicle,
        "propeller": {
            "k_thrust": {"value": k_thrust, "source": source},
            "k_torque": {"value": k_torque, "source": guess},
            "radius": frame.rotor_radius,
        },
    }
    return vehicle_from_mapping(values, f"airframe '{frame.name}'")

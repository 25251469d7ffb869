"""A vehicle file as the airframe of logs whose thrust is fitted to the flights themselves."""

from __future__ import annotations

from tombo_flight.vehicle_file import VehicleFile
from tombo_logs.flight_log import Airframe


def airframe_of(file: VehicleFile) -> Airframe:
    """Return what the logs need to know of a vehicle."""
    v = file.vehicle
    return Airframe(
        name=file.name,
        mass=v.mass,
        arm_length=v.arm_length,
        rotor_radius=v.rotor_radius,
        inertia=(v.inertia_xx, v.inertia_yy, v.inertia_zz),
        motor_time_constant=v.motor_time_constant,
    )

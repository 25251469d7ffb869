"""Limits of a flight over PX4: where, how fast and how tilted the vehicle may be."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from tombo_control.safety.flight_volume import clamp_to_volume, outside_volume
from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_dynamics.messages import PositionSetpoint
from tombo_dynamics.records import parameter_record
from tombo_dynamics.rotation import tilt
from tombo_px4.link.decoded_messages import VehicleOdometry


@dataclass(frozen=True)
class FlightLimits:
    """The flight volume, and the limits of speed and tilt."""

    volume: FlightVolume = field(default_factory=FlightVolume)
    safety: SafetyParams = field(default_factory=SafetyParams)

    @cached_property
    def _record(self) -> Any:
        return parameter_record(self.volume)

    def inside(self, setpoint: PositionSetpoint) -> tuple[PositionSetpoint, bool]:
        """Return a set point inside of the volume, and whether it was moved."""
        place = setpoint.position.astype(float)
        moved = clamp_to_volume(place, self._record)
        if not moved:
            return setpoint, False
        still = np.zeros(3)
        return replace(setpoint, position=place, velocity=still, acceleration=still), True

    def broken(self, odometry: VehicleOdometry) -> str:
        """Return which limit the vehicle is beyond; "" if none."""
        away = outside_volume(odometry.position, self._record)
        if away > self.volume.margin:
            return f"{away:.2f} m outside of the flight volume (volume)"
        speed = float(np.linalg.norm(odometry.velocity))
        if speed > self.safety.speed_max:
            return (
                f"{speed:.1f} m/s fast, allowed are {self.safety.speed_max:g} (safety.speed_max)"
            )
        lean = float(tilt(odometry.attitude[None])[0])
        if lean > self.safety.tilt_max:
            return (
                f"tilted by {lean:.2f} rad, allowed are {self.safety.tilt_max:g} (safety.tilt_max)"
            )
        return ""

"""What travels between estimator, mission and controller."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.time_base import TICK_NS


@compiled
def nearest_tick(stamp_ns: int) -> int:
    """Return the tick of 1 ms nearest to a stamp."""
    return (stamp_ns + TICK_NS // 2) // TICK_NS


@dataclass(frozen=True)
class StampedEstimate:
    """State of the vehicle at the capture of a gyro sample."""

    stamp_ns: int
    position: Array
    """(3) of base_link in map [m]."""
    velocity: Array
    """(3) of base_link in map [m/s]."""
    attitude: Array
    """(4) xyzw, map from base_link."""
    rates: Array
    """(3) [rad/s], base_link, bias removed."""
    gyro_bias: Array
    """(3) [rad/s]."""
    accel_bias: Array
    """(3) [m/s^2]."""
    pose_stamp_ns: int
    """Capture time of the last pose used."""

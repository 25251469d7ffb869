"""The simulated world: vehicle, propeller, obstacle, spread between flights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tombo_dynamics.params import param
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice
from tombo_dynamics.vehicle import VehicleParams


@dataclass(frozen=True)
class ObstacleParams:
    """The obstacle: a solid vertical cylinder on the floor. Radius 0: there is none."""

    x: float = param(0.0, "m", (-1e3, 1e3), "axis, map x")
    y: float = param(0.0, "m", (-1e3, 1e3), "axis, map y")
    radius: float = param(0.0, "m", (0.0, 100.0), "radius; 0: no obstacle")
    top: float = param(
        10.0, "m", (0.0, 100.0), "height of its top", "estimated: above the flights of a hall"
    )


@dataclass(frozen=True)
class SpreadParams:
    """What differs from seed to seed besides the noise of the effects."""

    start: float = param(0.02, "m", (0.0, 2.0), "standard deviation of the start, x and y")
    yaw: float = param(0.02, "rad", (0.0, 3.2), "standard deviation of the heading at the start")
    obstacle: float = param(0.01, "m", (0.0, 1.0), "standard deviation of the obstacle, x and y")
    recovery_time: float = param(
        0.0, "1", (0.0, 0.9), "largest change of the blades' recovery time, share of it, uniform"
    )
    motor_lag: float = param(
        0.0, "1", (0.0, 0.9), "largest change of the motors' time constant, share of it, uniform"
    )
    wind: float = param(
        0.0, "m/s", (0.0, 15.0), "steady wind added, from a direction drawn uniformly"
    )
    mocap_rate: float = param(
        0.0, "Hz", (0.0, 500.0), "rate of the motion capture in half of the flights; 0: in none"
    )


@dataclass(frozen=True)
class World:
    """All that a simulation is made from, besides the seed."""

    vehicle: VehicleParams = field(default_factory=VehicleParams)
    propeller: PropellerChoice = field(default_factory=PropellerChoice)
    obstacle: ObstacleParams = field(default_factory=ObstacleParams)
    spread: SpreadParams = field(default_factory=SpreadParams)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """As given; effects of the propeller are added."""
    mocap_rate: float = 30.0
    """[Hz]."""
    start: tuple[float, float] = (0.0, 0.0)
    """Where the vehicle stands before the spread, map x and y [m]."""

"""The registry of what can act on a flight, for simulation and fit alike.

An effect takes `(plant, noise, *theta)`: the vehicle (`tombo_dynamics.plant.Plant`), standard
normal numbers of the tick (or of the mocap sample), and its parameters; it is compiled. One with
memory declares `state=`, a `Record`, and takes its own between noise and parameters.
"""

from __future__ import annotations

from enum import Enum

from tombo_dynamics.effect_registry import Effect, Param, Registry
from tombo_dynamics.jit import compiled


class Stage(Enum):
    """When in a tick an effect acts, and what it may change in the plant."""

    BODY = "body"
    """Once, before the flight: mass, inertia, centre of gravity, motor time constant, draws."""
    AIR = "air"
    """Each tick: adds to `wind`."""
    ROTOR = "rotor"
    """Each tick: multiplies `efficiency`, moves `fold` and `damage`, adds strike forces."""
    COMMAND = "command"
    """Each tick: changes `rotor_target`, the speeds that the drives work towards."""
    WRENCH = "wrench"
    """Each evaluation of the dynamics: adds to `force` and `moment`."""
    IMU = "imu"
    """Each tick: changes `gyro` and `accel`."""
    MOCAP = "mocap"
    """Each motion-capture sample: changes `mocap`."""


REGISTRY = Registry("effect", leading=2, prepare=compiled)
effect = REGISTRY.effect
check_theta = REGISTRY.check_theta

__all__ = ["REGISTRY", "Effect", "Param", "Stage", "check_theta", "effect"]

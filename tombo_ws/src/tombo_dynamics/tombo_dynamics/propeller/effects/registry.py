"""The registry of faults of a thrust-stand run, for simulation and fit.

An effect's function takes `(run, *theta)` and changes a `StandRun` in place; it is not compiled.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from tombo_dynamics.arrays import Array
from tombo_dynamics.effect_registry import Param, Registry
from tombo_dynamics.propeller.laws.parameters import SCALARS


class StandStage(IntEnum):
    """When an effect acts; within a stage in the order of the registry."""

    SPEED = 0
    """Changes the true speed, given what the tachometer says."""
    PROPELLER = 1
    """Changes the parameter rows that the law is solved with, and the air's inflow."""
    LOAD = 2
    """Changes the true loads after the law is solved."""
    READING = 3
    """Changes what the instruments show."""


STAND_EFFECTS = Registry("stand effect", leading=1)
stand_effect = STAND_EFFECTS.effect
check_stand_theta = STAND_EFFECTS.check_theta


CHANNELS = ("thrust", "torque", "beta", "reference_speed")
"""Quantities that a stand may measure; in N, N m, rad, rad/s."""
LIFT, DRAG, TORQUE = slice(18, 24), slice(24, 30), slice(30, 36)
"""Places of the wing's weights in a parameter row."""


@dataclass
class StandRun:
    """Operating points on their way from the tachometer to the readings; all (N,) but rows."""

    speed: Array
    """True rotor speed [rad/s]; starts as what the tachometer says."""
    rows: Array
    """(N, ROW_SIZE) parameters of the propeller; (N, 2), k_T and k_Q, of a plain one."""
    plain: bool
    share: Array
    """Share of both wings' load that one nodus carries, 1 in the published load model."""
    other_law: Array
    """Share of the law with the other in-plane term."""
    inflow: Array
    """Uniform induced velocity in units of the momentum theory's, 0: none."""
    exponent: Array
    """Added to the exponent 2 of the speed, plain propellers."""
    elapsed: Array
    """Share of the run that has passed, 0 to 1."""
    applied_thrust: Array
    """Known load hung on the cell besides [N]."""
    applied_torque: Array
    """[N m]"""
    propeller_draws: Array
    """(N, 2) standard normal draws of the propeller at each point: lift, drag."""
    run_draws: Array
    """(N, 2) of the run: tare of thrust, of torque."""
    share_draws: Array
    """(N, 2) of the run: share by which thrust, torque are off."""
    point_draws: Array
    """Of each point: speed."""
    thrust: Array
    torque: Array
    beta: Array
    """Flap angle [rad]."""
    reference_speed: Array
    """Reading of an independent tachometer [rad/s]."""
    largest_thrust: float
    """Range of the cell that is used [N]."""
    largest_torque: float

    def scale(self, name: str, factor: Array | float) -> None:
        """Multiply one of the rows' `SCALARS`."""
        self.rows[:, SCALARS[name]] *= factor


__all__ = [
    "CHANNELS",
    "STAND_EFFECTS",
    "Param",
    "StandRun",
    "StandStage",
    "check_stand_theta",
    "stand_effect",
]

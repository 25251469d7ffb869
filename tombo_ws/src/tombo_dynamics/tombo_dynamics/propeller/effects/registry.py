"""The registry of what can be wrong in a thrust-stand run, for simulation and fit alike.

An effect's function takes `(run, *theta)` and changes a `Run` in place; nothing here is compiled.
"""

from __future__ import annotations

from enum import IntEnum

from tombo_dynamics.effect_registry import Param, Registry


class Stage(IntEnum):
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

__all__ = ["STAND_EFFECTS", "Param", "Stage", "check_stand_theta", "stand_effect"]

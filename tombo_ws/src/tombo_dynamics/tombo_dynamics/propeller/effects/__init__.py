"""Errors of a thrust-stand run, each as one function, and the predicted readings."""

# The registry keeps this order: effects on the rotor, then on the readings of the stand.
from tombo_dynamics.propeller.effects import rotor, readings  # isort: skip
from tombo_dynamics.propeller.effects.predict import Draws, Setup, nulls, predict
from tombo_dynamics.propeller.effects.registry import (
    CHANNELS,
    STAND_EFFECTS,
    Param,
    StandRun,
    StandStage,
    check_stand_theta,
    stand_effect,
)

__all__ = [
    "CHANNELS",
    "STAND_EFFECTS",
    "Draws",
    "Param",
    "Setup",
    "StandRun",
    "StandStage",
    "check_stand_theta",
    "nulls",
    "predict",
    "readings",
    "rotor",
    "stand_effect",
]

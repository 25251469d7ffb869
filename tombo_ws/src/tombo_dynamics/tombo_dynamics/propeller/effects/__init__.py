"""What can be wrong in a thrust-stand run, each as one function; and what the stand then reads."""

from tombo_dynamics.propeller.effects import air, nodus, readings
from tombo_dynamics.propeller.effects.predict import Draws, Setup, nulls, predict
from tombo_dynamics.propeller.effects.registry import (
    STAND_EFFECTS,
    Param,
    Stage,
    check_stand_theta,
    stand_effect,
)
from tombo_dynamics.propeller.effects.run_state import CHANNELS, Run

__all__ = [
    "CHANNELS",
    "STAND_EFFECTS",
    "Draws",
    "Param",
    "Run",
    "Setup",
    "Stage",
    "air",
    "check_stand_theta",
    "nodus",
    "nulls",
    "predict",
    "readings",
    "stand_effect",
]

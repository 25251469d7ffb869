"""The demand of four rotors: thrust by drive channel, its parts, and its spread in health."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

EXPONENT: Final[Mapping[str, tuple[float, float]]] = {
    "rotor_speed": (2.0, 0.15), "rotor_command": (2.0, 0.15), "motor_command": (1.0, 0.3),
}  # fmt: skip
"""Of thrust in each drive channel before a fit, and its standard deviation: of speeds the square
law, which Reynolds' number and bending blades change (1.8 for the suite's propeller)."""
MODES: Final = np.array([[1.0, 1, 1, 1], [-1, 1, 1, -1], [-1, 1, -1, 1], [1, 1, -1, -1]]) / 4.0
"""Collective, roll, pitch and yaw part of four numbers in the order of ROTOR_NAMES."""
HOVER_SPEED: Final = 1000.0
"""rad/s, taken as the hover speed where only thrust counts: speeds are a way to write it."""
SESSION_MODES: Final = (0.028, 0.006, 0.011, 0.049)
"""Spread of demand between sessions before any flight is seen, of logarithms: part of all rotors,
roll, pitch, yaw. Fitted, with `SESSION_DEGREES`, to 14 healthy sessions of four Crazyflies of
three laboratories: maximum of the posterior of a Student's t."""
SESSION_DEGREES: Final = 5.0
"""Degrees of freedom of that t: how much the spread as a whole differs between vehicles."""
SESSION_ROTOR: Final = 0.003
"""The same spread of a single rotor."""
SESSION_SCATTER: Final = math.hypot(SESSION_ROTOR, *SESSION_MODES[1:])
"""The same of a rotor, without the common part of all rotors."""

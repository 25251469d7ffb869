"""Moving air. It acts through the drag effects: without drag, wind does nothing."""

from __future__ import annotations

import math

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P


@effect(
    "steady_wind",
    Stage.AIR,
    [
        Param("east", "m/s", 0.0, (-15.0, 15.0), "velocity of the air along map x", 1.5),
        Param("north", "m/s", 0.0, (-15.0, 15.0), "velocity of the air along map y", 0.0),
    ],
    signature="a constant horizontal force in map, whatever the heading",
    separates_from={
        "imu_bias": "turn by 90 to 180 deg in hover",
        "mocap_misalignment": "the pose at rest on a level floor: wind does not lean it",
        "linear_rotor_drag": "both ways",
    },
)
def steady_wind(m: Array, noise: Array, east: float, north: float) -> None:
    """Let the air move with a constant horizontal velocity."""
    m[P.wind] += east
    m[P.wind + 1] += north


@effect(
    "gusts",
    Stage.AIR,
    [
        Param("deviation", "m/s", 0.0, (0.0, 5.0), "standard deviation of each component", 0.7),
        Param("time", "s", 1.0, (0.05, 30.0), "correlation time", 1.0),
    ],
    signature="random force, correlated over the gust's time, not repeatable",
)
def gusts(m: Array, noise: Array, deviation: float, time: float) -> None:
    """Let the air's velocity wander as a first-order Gauss-Markov process."""
    decay = math.exp(-m[P.clock + 1] / time)
    drive = deviation * math.sqrt(1.0 - decay * decay)
    for i in range(3):
        m[P.gust + i] = decay * m[P.gust + i] + drive * noise[i]
        m[P.wind + i] += m[P.gust + i]

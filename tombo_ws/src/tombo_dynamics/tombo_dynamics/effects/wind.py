"""Moving air. It acts through the drag effects: without drag, wind does nothing."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.vectors import add, add_scaled, scale


@effect(
    "steady_wind",
    Stage.AIR,
    [
        Param("east", "m/s", 0.0, (-15.0, 15.0), "velocity of the air along map x", 1.5),
        Param("north", "m/s", 0.0, (-15.0, 15.0), "velocity of the air along map y", 0.0),
        Param("swing_east", "m/s", 0.0, (-15.0, 15.0), "amplitude of its swing along map x", 1.5),
        Param("swing_north", "m/s", 0.0, (-15.0, 15.0), "amplitude of its swing along map y", 0.0),
        Param("frequency", "Hz", 0.0, (0.0, 10.0), "of the swing", 0.3),
        Param("phase", "rad", 0.0, (-math.pi, math.pi), "of the swing at the start", 0.0),
    ],
    signature="a horizontal force in map, whatever the heading: constant, or with a swing",
    separates_from={
        "imu_bias": "turn by 90 to 180 deg in hover",
        "mocap_misalignment": "the pose at rest on a level floor: wind does not lean it",
        "linear_rotor_drag": "both ways",
    },
    healthy_spread=0.0,
)
def steady_wind(
    plant: Plant,
    noise: Array,
    east: float,
    north: float,
    swing_east: float,
    swing_north: float,
    frequency: float,
    phase: float,
) -> None:
    """Let the air move with a constant horizontal velocity, and a sinusoidal one on top of it."""
    plant.wind[0] += east
    plant.wind[1] += north
    if swing_east != 0.0 or swing_north != 0.0:
        time = plant.ticks * plant.tick_length
        swing = math.sin(2.0 * math.pi * frequency * time + phase)
        plant.wind[0] += swing_east * swing
        plant.wind[1] += swing_north * swing


class GustState(Record):
    """What gusts remember."""

    velocity = field("m/s", "of the gust, map", 3)
    time = field("s", "correlation time that `decay` and `spread` are of; 0: of none yet")
    decay = field("1", "what is left of the velocity after a tick")
    spread = field("1", "deviation of what is new in a tick, over that of the velocity")


@effect(
    "gusts",
    Stage.AIR,
    [
        Param("deviation", "m/s", 0.0, (0.0, 5.0), "standard deviation of each component", 0.7),
        Param("time", "s", 1.0, (0.05, 30.0), "correlation time", 1.0),
    ],
    signature="random force, correlated over the gust's time, not repeatable",
    state=GustState,
    stochastic=True,
)
def gusts(plant: Plant, noise: Array, state: GustState, deviation: float, time: float) -> None:
    """Let the air's velocity wander as a first-order Gauss-Markov process."""
    if deviation <= 0.0:
        return
    if state.time != time:
        state.time = time
        state.decay = math.exp(-plant.tick_length / time)
        state.spread = math.sqrt(1.0 - state.decay * state.decay)
    drive = deviation * state.spread
    state.velocity = add_scaled(scale(state.decay, state.velocity), drive, noise)
    plant.wind = add(plant.wind, state.velocity)

"""Open-loop simulation from measured states: how far it is off half a second or a second later."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import DELAY_TICKS, Plant, set_state
from tombo_dynamics.rigid_body import begin_flight, begin_tick, finish_tick
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.rotors import impose_rotor_target, sum_rotors
from tombo_dynamics.vectors import store


@compiled
def open_loop(
    plant: Plant,
    maps: RotorMaps,
    theta: Array,
    tick: float,
    motion: Array,
    command: Array,
    speed: Array,
    along: Any,
    starts: NDArray[np.int64],
    ticks: int,
    hold_attitude: bool,
    out: Any,
) -> None:
    """Simulate windows from measured states, with the commands that were recorded.

    A load that hangs and swings goes on swinging.

    Args:
        plant: its draws are set; changed.
        maps: the rotor's table.
        theta: parameters of all effects.
        tick: distance of the rows [s].
        motion: (N, 13) measured position, velocity, quaternion, body rates.
        command: (N, 4) rotor speeds asked for [rad/s].
        speed: (N, 8) measured rotor speeds and slopes, which are then imposed, or (0, 8).
        along: (N,) `tombo_sim.inverse_simulation.ImposedTick` of the model along the measured
            motion: its rotor speeds, and what its effects remember, are where windows begin.
        starts: (W,) rows at which windows begin.
        ticks: length of a window.
        hold_attitude: True: attitude and rates stay the measured ones throughout.
        out: (W,) `State` at the end of each window, filled.
    """
    noise = np.zeros(9)
    measured = speed.shape[0] > 0
    for w in range(starts.size):
        first = starts[w]
        begin_flight(plant, noise, theta, tick)
        plant.clear_height = -1e9
        set_state(plant.state, motion[first])
        plant.rotor_speed = along[first].rotor_speed
        plant.memories = along[max(first - 1, 0)].memories
        plant.ticks = DELAY_TICKS
        for back in range(DELAY_TICKS):
            row = max(first - 1 - back, 0)
            store(plant.past_commands[DELAY_TICKS - 1 - back], command[row])
        for k in range(first, first + ticks):
            if hold_attitude:
                plant.state.attitude = motion[k, 6:10]
                plant.state.rates = motion[k, 10:13]
            store(plant.rotor_command, command[k])
            if measured:
                store(plant.rotor_speed, speed[k, 0:4])
            begin_tick(plant, maps, noise, theta)
            if measured:
                impose_rotor_target(plant, speed[k])
                sum_rotors(plant, maps, 1.0, 0)
                sum_rotors(plant, maps, plant.half_tick_decay, 1)
                sum_rotors(plant, maps, plant.tick_decay, 2)
            finish_tick(plant, noise, theta)
        out[w] = plant.state

"""The model let go from measured states: how far it is off half a second or a second later."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import DELAY_TICKS, P
from tombo_dynamics.rigid_body import begin_flight, begin_tick, finish_tick
from tombo_dynamics.rotors import rotor_wrench


@compiled
def open_loop(
    m: Array,
    maps: Array,
    theta: Array,
    tick: float,
    motion: Array,
    command: Array,
    speed: Array,
    drives: Array,
    starts: NDArray[np.int64],
    ticks: int,
    hold_attitude: bool,
    out: Array,
) -> None:
    """Simulate windows from measured states, with the commands that were recorded.

    Args:
        m: memory of a plant, its draws set; changed.
        maps: the rotor's table.
        theta: parameters of all effects.
        tick: distance of the rows [s].
        motion: (N, 13) measured position, velocity, quaternion, body rates.
        command: (N, 4) rotor speeds asked for [rad/s].
        speed: (N, 8) measured rotor speeds and slopes, which are then imposed, or (0, 8).
        drives: (N, 4) rotor speeds of the model along the measured motion [rad/s].
        starts: (W,) rows at which windows begin.
        ticks: length of a window.
        hold_attitude: True: attitude and rates stay the measured ones throughout.
        out: (W, 13) state at the end of each window, filled.
    """
    noise = np.zeros(9)
    measured = speed.shape[0] > 0
    for w in range(starts.size):
        first = starts[w]
        begin_flight(m, noise, theta, tick)
        m[P.inertial + 14] = -1e9
        for j in range(13):
            m[P.body + j] = motion[first, j]
        for i in range(4):
            m[P.speed + i] = drives[first, i]
        m[P.clock] = DELAY_TICKS
        for back in range(DELAY_TICKS):
            row = max(first - 1 - back, 0)
            slot = P.delay + 4 * ((DELAY_TICKS - 1 - back) % DELAY_TICKS)
            for i in range(4):
                m[slot + i] = command[row, i]
        for k in range(first, first + ticks):
            if hold_attitude:
                for j in range(6, 13):
                    m[P.body + j] = motion[k, j]
            for i in range(4):
                m[P.command + i] = command[k, i]
                if measured:
                    m[P.speed + i] = speed[k, i]
            begin_tick(m, maps, noise, theta)
            if measured:
                for i in range(4):
                    m[P.target + i] = speed[k, i] + m[P.inertial + 4] * speed[k, 4 + i]
                rotor_wrench(m, maps, 1.0, 0)
                rotor_wrench(m, maps, m[P.inertial + 8], 1)
                rotor_wrench(m, maps, m[P.inertial + 9], 2)
            finish_tick(m, noise, theta)
        for j in range(13):
            out[w, j] = m[P.body + j]

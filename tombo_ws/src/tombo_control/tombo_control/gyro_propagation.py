"""Between two estimates: the controller carries attitude and position on with its own gyro.

The estimate comes from another process, 250 times a second and some milliseconds late. The rate
loop's gyro is here already; turning the attitude with it takes the delay out of the attitude loop,
and keeps the vehicle level for some seconds when no estimate comes at all.
"""

from __future__ import annotations

import math

from tombo_control.autopilot import HISTORY_TICKS, Autopilot, State
from tombo_control.estimator import store_history, update_body_rates
from tombo_control.loops.cascade import run_control_loops
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotation import rotate_by_vector, rotated, rotation_vector
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vectors import scale, subtract
from tombo_dynamics.vehicle import GRAVITY


@compiled
def propagate(state: State, history: Array, tick: int, ticks: int) -> None:
    """Carry attitude and position over `ticks` ticks to `tick`, with rates and velocity held.

    Reads and writes `state`; each tick on the way is entered in `history`.
    """
    rates = state.rates
    for k in range(ticks):
        for i in range(3):
            state.position[i] += TICK_S * state.velocity[i]
        rotate_by_vector(state.attitude, scale(TICK_S, rates))
        store_history(state, history, tick - ticks + k + 1)


@compiled
def integrate_force(state: State, accel: Array, ticks: int) -> bool:
    """Carry the velocity over `ticks` ticks with the specific force, less its bias.

    False: that is not finite, the velocity is no longer known.

    Args:
        state: velocity is written; attitude and `accel_bias` are used.
        accel: (3) specific force [m/s^2], body.
        ticks: since the last sample.
    """
    ax, ay, az = rotated(state.attitude, subtract(accel, state.accel_bias))
    if not math.isfinite(ax + ay + az):
        return False
    state.velocity[0] += ticks * TICK_S * ax
    state.velocity[1] += ticks * TICK_S * ay
    state.velocity[2] += ticks * TICK_S * (az - GRAVITY)
    return True


@compiled(inline=False)
def correct_with_estimate(
    state: State,
    history: Array,
    position: Array,
    velocity: Array,
    attitude: Array,
    captured: int,
    now: int,
) -> None:
    """Take an estimate that was true at tick `captured`; `now` is the present tick.

    Writes position, velocity and attitude of `state`, and turns what `history` has since then.

    Args:
        state: at tick `now`.
        history: of the autopilot.
        position: (3) [m], map.
        velocity: (3) [m/s], map.
        attitude: (4) quaternion xyzw, map from base_link.
        captured: tick of the estimate; older than the history: it is taken as it is.
        now: present tick.
    """
    late = (now - captured) * TICK_S
    for i in range(3):
        state.velocity[i] = velocity[i]
        state.position[i] = position[i] + late * velocity[i]
    past = history[captured % HISTORY_TICKS]
    if captured > now or past.tick != captured:
        for i in range(4):
            state.attitude[i] = attitude[i]
        if captured > now:  # it came before the gyro sample it was made from: turn it back
            rotate_by_vector(state.attitude, scale(late, state.rates))
        store_history(state, history, now)
        return
    turn = rotation_vector(attitude, past.attitude)
    for tick in range(captured, now + 1):  # the next estimate is held against the history too
        q = history[tick % HISTORY_TICKS].attitude
        rotate_by_vector(q, turn)
    present = history[now % HISTORY_TICKS]
    state.attitude = present.attitude


@compiled
def control_tick(
    autopilot: Autopilot,
    maps: RotorMaps,
    gyro: Array,
    tick: int,
    ticks: int,
    position: bool,
    attitude: bool,
    blind: bool,
) -> None:
    """Carry the state on to the gyro sample of `tick`, take it, and run the loops that are due.

    Args:
        autopilot: as in `run_control_loops`; state and history are written, too.
        maps: the rotor's table.
        gyro: (3) [rad/s], body frame.
        tick: tick of the sample.
        ticks: ticks since the sample before.
        position: the position loop is due.
        attitude: the attitude loop is due.
        blind: the position is not known.
    """
    propagate(autopilot.state, autopilot.history, tick, ticks)
    update_body_rates(autopilot.state, gyro)
    run_control_loops(autopilot, maps, position, attitude, blind)

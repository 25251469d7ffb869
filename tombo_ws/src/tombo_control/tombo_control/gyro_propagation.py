"""Between two estimates: the controller carries attitude and position on with its own gyro.

The estimate comes from another process, 250 times a second and some milliseconds late. The rate
loop's gyro is here already; turning the attitude with it takes the delay out of the attitude loop,
and keeps the vehicle level for some seconds when no estimate comes at all.
"""

from __future__ import annotations

import math

from tombo_control.autopilot import HISTORY_TICKS, A
from tombo_control.cascade import run_control_loops
from tombo_control.estimator import store_history, update_body_rates
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled, compiled_call
from tombo_dynamics.rotation import relative_rotation, rotate_by_vector
from tombo_dynamics.rotor_maps import RotorMaps

_TICK = 1e-3


@compiled
def propagate(a: Array, tick: int, ticks: int) -> None:
    """Carry attitude and position over `ticks` ticks to `tick`, with rates and velocity held."""
    for k in range(ticks):
        for i in range(3):
            a[A.position + i] += _TICK * a[A.velocity + i]
        rotate_by_vector(
            a[A.attitude : A.attitude + 4],
            a[A.rates] * _TICK,
            a[A.rates + 1] * _TICK,
            a[A.rates + 2] * _TICK,
        )
        store_history(a, tick - ticks + k + 1)


@compiled_call
def correct_with_estimate(a: Array, estimate: Array, captured: int, now: int) -> None:
    """Take an estimate that was true at tick `captured`; `now` is the present tick.

    Args:
        a: the autopilot's memory.
        estimate: (10) position [m], velocity [m/s] in map, quaternion xyzw, map from base_link.
        captured: tick of the estimate; older than the history: it is taken as it is.
        now: present tick.
    """
    late = (now - captured) * _TICK
    for i in range(3):
        a[A.velocity + i] = estimate[3 + i]
        a[A.position + i] = estimate[i] + late * estimate[3 + i]
    slot = A.history + 8 * (captured % HISTORY_TICKS)
    if captured > now or a[slot + 7] != captured:
        for i in range(4):
            a[A.attitude + i] = estimate[6 + i]
        if captured > now:  # it came before the gyro sample it was made from: turn it back
            x, y, z = a[A.rates], a[A.rates + 1], a[A.rates + 2]
            rotate_by_vector(a[A.attitude : A.attitude + 4], late * x, late * y, late * z)
        store_history(a, now)
        return
    x, y, z, w = relative_rotation(estimate[6:10], a[slot + 3 : slot + 7])
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    for tick in range(captured, now + 1):  # the next estimate is held against the history too
        past = A.history + 8 * (tick % HISTORY_TICKS)
        rotate_by_vector(a[past + 3 : past + 7], scale * x, scale * y, scale * z)
    present = A.history + 8 * (now % HISTORY_TICKS)
    for i in range(4):
        a[A.attitude + i] = a[present + 3 + i]


@compiled
def control_tick(
    a: Array,
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
        a: the autopilot's memory.
        maps: the rotor's table.
        gyro: (3) [rad/s], body frame.
        tick: tick of the sample.
        ticks: ticks since the sample before.
        position: the position loop is due.
        attitude: the attitude loop is due.
        blind: the position is not known.
    """
    propagate(a, tick, ticks)
    update_body_rates(a, gyro, 0)
    run_control_loops(a, maps, position, attitude, blind)

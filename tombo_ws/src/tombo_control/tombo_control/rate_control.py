"""Rate PID with derivative filter and anti-windup: angular acceleration from the rate error."""

from __future__ import annotations

from tombo_control.autopilot import A, G
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled

_TICK = 1e-3
_RATE = 1e3


@compiled
def rate_control(a: Array) -> None:
    """Run the 1000 Hz loop on the gyro: set the angular acceleration [rad/s^2].

    The derivative acts on the low-passed measurement, not on the error (no kick from a set point).
    The integral stops in a direction in which the allocation has no more to give, and is bounded.
    """
    smooth = a[G.rate_cutoff] * _TICK / (1.0 + a[G.rate_cutoff] * _TICK)
    for i in range(3):
        step = smooth * (a[A.rates + i] - a[A.rate_filtered + i])
        a[A.rate_filtered + i] += step
        error = a[A.rates_setpoint + i] - a[A.rates + i]
        p = a[G.yaw_rate_p] if i == 2 else a[G.rate_p]
        k = a[G.yaw_rate_i] if i == 2 else a[G.rate_i]
        d = 0.0 if i == 2 else a[G.rate_d]
        if a[A.saturated + i] * error <= 0.0:
            total = a[A.rate_integral + i] + k * error * _TICK
            a[A.rate_integral + i] = min(max(total, -a[G.rate_i_max]), a[G.rate_i_max])
        a[A.torque_setpoint + i] = p * error + a[A.rate_integral + i] - d * step * _RATE

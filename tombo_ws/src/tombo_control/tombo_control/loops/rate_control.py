"""Rate PID with derivative filter and anti-windup: angular acceleration from the rate error."""

from __future__ import annotations

from tombo_control.autopilot import LoopMemory, Setpoint, State
from tombo_control.params import ControlParams
from tombo_dynamics.jit import compiled
from tombo_dynamics.time_base import TICK_S

_RATE = 1e3


@compiled
def rate_control(
    state: State, setpoint: Setpoint, loops: LoopMemory, gains: ControlParams
) -> None:
    """Run the 1000 Hz loop: `setpoint.angular_acceleration` from the error of the body rates.

    The error is from `state.rates` to `setpoint.rates`. The derivative acts on the low-passed
    measurement, not on the error (no kick from a set point). The integral stops in a direction in
    which the allocation has no more to give (`loops.saturated`), and is bounded. Writes
    `rate_filtered` and `rate_integral` of `loops`, too.
    """
    smooth = gains.rate_cutoff * TICK_S / (1.0 + gains.rate_cutoff * TICK_S)
    for i in range(3):
        step = smooth * (state.rates[i] - loops.rate_filtered[i])
        loops.rate_filtered[i] += step
        error = setpoint.rates[i] - state.rates[i]
        p = gains.yaw_rate_p if i == 2 else gains.rate_p
        k = gains.yaw_rate_i if i == 2 else gains.rate_i
        d = 0.0 if i == 2 else gains.rate_d
        if loops.saturated[i] * error <= 0.0:
            total = loops.rate_integral[i] + k * error * TICK_S
            loops.rate_integral[i] = min(max(total, -gains.rate_i_max), gains.rate_i_max)
        setpoint.angular_acceleration[i] = p * error + loops.rate_integral[i] - d * step * _RATE

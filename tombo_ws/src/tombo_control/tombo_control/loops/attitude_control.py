"""Attitude P on quaternions: tilt first, yaw after."""

from __future__ import annotations

import math

from tombo_control.autopilot import Setpoint, State
from tombo_control.params import ControlParams
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotation import relative_rotation


@compiled
def attitude_control(state: State, setpoint: Setpoint, gains: ControlParams) -> None:
    """Run the 250 Hz loop: `setpoint.rates` from the error of attitude.

    The error, from `state.attitude` to `setpoint.attitude`, is split into the shortest turn that
    aligns body z and a turn about it, each with its own gain, so a large yaw error never bends the
    way to level (Brescianini et al. 2013, Eqs. 9 to 12). The quaternion's sign does not matter.
    """
    x, y, z, w = relative_rotation(setpoint.attitude, state.attitude)
    upright = math.sqrt(w * w + z * z)
    if upright > 1e-6:
        tx = (w * x - y * z) / upright
        ty = (w * y + x * z) / upright
        yaw = z / upright
    else:
        tx = x
        ty = y
        yaw = 0.0
    sine = math.sqrt(tx * tx + ty * ty)
    gain = 2.0 * gains.attitude_p
    if sine > 1e-9:
        gain *= math.atan2(sine, upright) / sine
    px = gain * tx
    py = gain * ty
    fast = math.sqrt(px * px + py * py) / gains.rate_max
    if fast > 1.0:
        px /= fast
        py /= fast
    pz = gains.yaw_p * 2.0 * math.asin(min(max(yaw, -1.0), 1.0))
    setpoint.rates[0] = px
    setpoint.rates[1] = py
    setpoint.rates[2] = min(max(pz, -gains.yaw_rate_max), gains.yaw_rate_max)

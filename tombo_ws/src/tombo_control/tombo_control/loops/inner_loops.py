"""From attitude to rotor thrusts: attitude P, rate PID, and the allocation with its limits."""

from __future__ import annotations

import math

from tombo_control.autopilot import EstimatedState, LoopMemory, Setpoint
from tombo_control.params import ControlParams
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotation import relative_rotation
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import TICK_HZ, TICK_S
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN, VehicleParams


@compiled
def attitude_control(state: EstimatedState, setpoint: Setpoint, gains: ControlParams) -> None:
    """Run the 250 Hz loop: `setpoint.rates` from the error of attitude.

    The error, from `state.attitude` to `setpoint.attitude`, is split into the shortest turn that
    aligns body z and a turn about it. Each has its own gain, so a large yaw error never bends the
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


@compiled
def rate_control(
    state: EstimatedState, setpoint: Setpoint, loops: LoopMemory, gains: ControlParams
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
        setpoint.angular_acceleration[i] = p * error + loops.rate_integral[i] - d * step * TICK_HZ


@compiled
def inertia_torque(state: EstimatedState, setpoint: Setpoint, nominal: VehicleParams) -> None:
    """Set `setpoint.torque`, which gives `setpoint.angular_acceleration` at `state.rates`.

    Euler's equation of the nominal airframe: I alpha + omega x (I omega).
    """
    wx, wy, wz = state.rates[0], state.rates[1], state.rates[2]
    ix, iy, iz = nominal.inertia_xx, nominal.inertia_yy, nominal.inertia_zz
    alpha, torque = setpoint.angular_acceleration, setpoint.torque
    torque[0] = ix * alpha[0] + (iz - iy) * wy * wz
    torque[1] = iy * alpha[1] + (ix - iz) * wz * wx
    torque[2] = iz * alpha[2] + (iy - ix) * wx * wy


@compiled
def allocate(
    setpoint: Setpoint, loops: LoopMemory, nominal: VehicleParams, maps: RotorMaps
) -> None:
    """Set `setpoint.rotor_thrust` for `setpoint.thrust` and `setpoint.torque`.

    When a rotor would idle or reach its highest thrust: roll and pitch are kept, the collective
    moves to make room for them, yaw gets what is left; only when roll and pitch alone span more
    than the range are they scaled down together. `loops.saturated` gets -1, 0 or +1 for each axis:
    that direction has no more to give. A rotor whose thrust would not be a number idles.

    Args:
        setpoint: as above.
        loops: as above.
        nominal: its arm length is used.
        maps: the rotor's limits, and its ratio of drag torque to thrust.
    """
    lowest, highest = maps.thrust_lowest, maps.thrust_highest
    out = setpoint.rotor_thrust
    roll, pitch, yaw = setpoint.torque[0], setpoint.torque[1], setpoint.torque[2]
    low = 0.0
    high = 0.0
    for i in range(4):
        out[i] = 0.5 / nominal.arm_length * (ARM_Y[i] * roll - ARM_X[i] * pitch)
        low = min(low, out[i])
        high = max(high, out[i])
    scale = min(1.0, (highest - lowest) / max(high - low, 1e-9))
    tilt_full = scale < 1.0
    mean = 0.25 * setpoint.thrust
    mean = min(max(mean, lowest - scale * low), highest - scale * high)
    share = 0.25 * yaw / maps.torque_ratio
    room = 1.0
    for i in range(4):
        out[i] = mean + scale * out[i]
        wanted = -SPIN[i] * share
        if wanted > 0.0:
            room = min(room, (highest - out[i]) / wanted)
        elif wanted < 0.0:
            room = min(room, (lowest - out[i]) / wanted)
    room = max(room, 0.0)
    for i in range(4):
        thrust = min(out[i] - SPIN[i] * share * room, highest)
        out[i] = thrust if thrust > lowest else lowest
    loops.saturated[0] = math.copysign(1.0, roll) if tilt_full else 0.0
    loops.saturated[1] = math.copysign(1.0, pitch) if tilt_full else 0.0
    loops.saturated[2] = math.copysign(1.0, yaw) if room < 1.0 else 0.0

"""From collective thrust and torques to four rotor thrusts, with priorities at the limits."""

from __future__ import annotations

import math

from tombo_control.autopilot import LoopMemory, Setpoint, State
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN, VehicleParams


@compiled
def inertia_torque(state: State, setpoint: Setpoint, nominal: VehicleParams) -> None:
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

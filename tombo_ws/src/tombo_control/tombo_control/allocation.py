"""From collective thrust and torques to four rotor thrusts, with priorities at the limits."""

from __future__ import annotations

import math

from tombo_control.autopilot import A, N
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN


@compiled
def inertia_torque(a: Array) -> None:
    """Turn the angular acceleration asked for into the torque that gives it, in place.

    Euler's equation of the nominal airframe: I alpha + omega x (I omega).
    """
    wx, wy, wz = a[A.rates], a[A.rates + 1], a[A.rates + 2]
    ix, iy, iz = a[N.inertia_xx], a[N.inertia_yy], a[N.inertia_zz]
    t = A.torque_setpoint
    a[t] = ix * a[t] + (iz - iy) * wy * wz
    a[t + 1] = iy * a[t + 1] + (ix - iz) * wz * wx
    a[t + 2] = iz * a[t + 2] + (iy - ix) * wx * wy


@compiled
def allocate(a: Array, ratio: float, lowest: float, highest: float) -> None:
    """Set the rotor thrusts for the collective thrust and the torques asked for.

    When a rotor would leave [lowest, highest]: roll and pitch are kept, the collective moves to
    make room for them, yaw gets what is left; only when roll and pitch alone span more than the
    range are they scaled down together. `A.saturated` gets -1, 0 or +1 for each axis: that
    direction has no more to give. A rotor whose thrust would not be a number idles.

    Args:
        a: the autopilot's memory.
        ratio: drag torque over thrust of a rotor [m].
        lowest: thrust of an idling rotor [N].
        highest: highest thrust of a rotor [N].
    """
    out = A.rotor_thrust
    roll = a[A.torque_setpoint]
    pitch = a[A.torque_setpoint + 1]
    yaw = a[A.torque_setpoint + 2]
    low = 0.0
    high = 0.0
    for i in range(4):
        a[out + i] = 0.5 / a[N.arm_length] * (ARM_Y[i] * roll - ARM_X[i] * pitch)
        low = min(low, a[out + i])
        high = max(high, a[out + i])
    scale = min(1.0, (highest - lowest) / max(high - low, 1e-9))
    tilt_full = scale < 1.0
    mean = 0.25 * a[A.thrust_setpoint]
    mean = min(max(mean, lowest - scale * low), highest - scale * high)
    share = 0.25 * yaw / ratio
    room = 1.0
    for i in range(4):
        a[out + i] = mean + scale * a[out + i]
        wanted = -SPIN[i] * share
        if wanted > 0.0:
            room = min(room, (highest - a[out + i]) / wanted)
        elif wanted < 0.0:
            room = min(room, (lowest - a[out + i]) / wanted)
    room = max(room, 0.0)
    for i in range(4):
        thrust = min(a[out + i] - SPIN[i] * share * room, highest)
        a[out + i] = thrust if thrust > lowest else lowest
    a[A.saturated] = math.copysign(1.0, roll) if tilt_full else 0.0
    a[A.saturated + 1] = math.copysign(1.0, pitch) if tilt_full else 0.0
    a[A.saturated + 2] = math.copysign(1.0, yaw) if room < 1.0 else 0.0

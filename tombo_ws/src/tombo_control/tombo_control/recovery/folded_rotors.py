"""Flying with a folded rotor: what thrust each rotor has, and how torques and thrust share it."""

from __future__ import annotations

import math

from tombo_control.autopilot import LoopMemory, Recovery, Setpoint
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.rotors import straightened, thrust_share
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN, VehicleParams


@compiled
def observe_folds(recovery: Recovery, ticks: int) -> None:
    """Carry the folds on over `ticks` ticks, by the known course of straightening."""
    for i in range(4):
        if recovery.fold[i] > 0.0:
            recovery.fold[i] = straightened(
                recovery.fold[i], recovery.recovery_time, ticks * TICK_S
            )
            recovery.share[i] = thrust_share(recovery.fold[i])


@compiled
def available_thrust(recovery: Recovery, maps: RotorMaps) -> float:
    """Return the highest collective thrust of the rotors as they are [N]."""
    share = recovery.share
    return float(maps.thrust_highest * (share[0] + share[1] + share[2] + share[3]))


@compiled
def allocate_folded(
    setpoint: Setpoint,
    loops: LoopMemory,
    recovery: Recovery,
    nominal: VehicleParams,
    maps: RotorMaps,
) -> None:
    """Set `setpoint.rotor_thrust` with limits of each rotor: tilt first, then thrust, then yaw.

    The differences of thrust within the two diagonals (rotors 0 and 1, 2 and 3) give roll and
    pitch torque; the sum of the diagonals' means gives thrust, their difference yaw.
    `rotor_thrust` is the thrust of a straight rotor with the same command.
    """
    share, out = recovery.share, setpoint.rotor_thrust
    roll, pitch, yaw = setpoint.torque[0], setpoint.torque[1], setpoint.torque[2]
    lowest = recovery.mean_lowest
    highest = recovery.mean_highest
    reached = True
    for k in range(2):
        i, j = 2 * k, 2 * k + 1
        half = 0.5 / nominal.arm_length * (ARM_Y[i] * roll - ARM_X[i] * pitch)
        low_i, high_i = maps.thrust_lowest * share[i], maps.thrust_highest * share[i]
        low_j, high_j = maps.thrust_lowest * share[j], maps.thrust_highest * share[j]
        within = min(max(half, 0.5 * (low_i - high_j)), 0.5 * (high_i - low_j))
        reached = reached and within == half
        recovery.difference[k] = within
        lowest[k] = max(low_i - within, low_j + within)
        highest[k] = min(high_i - within, high_j + within)
    total = 0.5 * setpoint.thrust
    total = min(max(total, lowest[0] + lowest[1]), highest[0] + highest[1])
    demanded = -SPIN[0] * 0.5 * yaw / maps.torque_ratio
    least = max(2.0 * lowest[0] - total, total - 2.0 * highest[1])
    most = min(2.0 * highest[0] - total, total - 2.0 * lowest[1])
    apart = min(max(demanded, least), most)
    for k in range(2):
        mean = 0.5 * (total + apart) if k == 0 else 0.5 * (total - apart)
        out[2 * k] = mean + recovery.difference[k]
        out[2 * k + 1] = mean - recovery.difference[k]
    for i in range(4):
        full = out[i] / max(share[i], 0.05)
        out[i] = min(max(full, maps.thrust_lowest), maps.thrust_highest)
    loops.saturated[0] = 0.0 if reached else math.copysign(1.0, roll)
    loops.saturated[1] = 0.0 if reached else math.copysign(1.0, pitch)
    loops.saturated[2] = 0.0 if apart == demanded else math.copysign(1.0, yaw)

"""Four rotors on their arms: speeds that follow their targets, forces, and how one folds."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotor_maps import RotorMaps, rotor_thrust, rotor_torque
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN

_REACH = 0.9
"""The recovery time of Table III is read as the time until 90 % of the thrust is back."""
_RECOVERY_CONSTANTS = -math.log(1.0 - _REACH ** (1.0 / 3.0))
"""Recovery time in time constants of the fold: thrust goes with (1 - fold)^3."""


@compiled
def straightened(fold: float, recovery_time: float, step: float) -> float:
    """Return the folded share after `step` [s] of straightening; below 1e-4 it is none.

    Args:
        fold: folded share, 0 to 1.
        recovery_time: from folded until 90 % of the thrust is back [s].
        step: time passed [s].
    """
    left = max(0.0, 1.0 - _RECOVERY_CONSTANTS * step / max(recovery_time, 1e-3))
    return fold * left if fold > 1e-4 else 0.0


@compiled
def thrust_share(fold: float) -> float:
    """Return the thrust of a folded rotor over that of a straight one with the same command.

    Speed reaches 1 - f of the command, and thrust at that speed is 1 - f: (1 - f)^3.
    """
    straight = 1.0 - fold
    return straight * straight * straight


@compiled
def sum_rotors(plant: Plant, maps: RotorMaps, decay: float, row: int) -> None:
    """Write thrust, moments and spin momentum of all rotors into `plant.rotors[row]`.

    The drives follow their target exponentially; `decay` is what is left of the gap to it.
    Moments are about the centre of gravity: arm times thrust, and the torque that turns each rotor
    (drag and acceleration) reacting on the body against its spin. Row 0, the start of the tick,
    also sets `rotor_thrust` and `rotor_torque`.
    """
    thrust = 0.0
    mx = 0.0
    my = 0.0
    mz = 0.0
    momentum = 0.0
    arm = plant.vehicle.arm_length
    inertia = plant.vehicle.rotor_inertia
    pull = inertia / plant.motor_time_constant
    for i in range(4):
        gap = (plant.rotor_target[i] - plant.rotor_speed[i]) * decay
        speed = plant.rotor_target[i] - gap
        t = plant.efficiency[i] * rotor_thrust(maps, speed)
        q = plant.efficiency[i] * rotor_torque(maps, speed)
        if row == 0:
            plant.rotor_thrust[i] = t
            plant.rotor_torque[i] = q
        thrust += t
        mx += (arm * ARM_Y[i] - plant.centre_of_gravity[1]) * t
        my -= (arm * ARM_X[i] - plant.centre_of_gravity[0]) * t
        mz -= SPIN[i] * (q + pull * gap)
        momentum += SPIN[i] * inertia * speed
    rotors = plant.rotors[row]
    rotors.thrust = thrust
    rotors.moment = (mx, my, mz)
    rotors.spin_momentum = momentum


@compiled
def impose_rotor_target(plant: Plant, speed: Array) -> None:
    """Let the rotors follow a measurement in this tick: (8) speeds [rad/s] and their slopes."""
    for i in range(4):
        plant.rotor_target[i] = speed[i] + plant.motor_time_constant * speed[4 + i]


@compiled
def advance_rotor_speeds(plant: Plant) -> None:
    """Carry the rotor speeds to the end of the tick."""
    for i in range(4):
        target = plant.rotor_target[i]
        plant.rotor_speed[i] = target + (plant.rotor_speed[i] - target) * plant.tick_decay

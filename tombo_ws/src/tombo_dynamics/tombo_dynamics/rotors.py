"""Four rotors on their arms: speeds that follow their targets, and the forces they make."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotor_maps import RotorMaps, rotor_thrust, rotor_torque
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN


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

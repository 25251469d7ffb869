"""Four rotors on their arms: speeds that follow their targets, and the forces they make."""

from __future__ import annotations

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Array, P, V
from tombo_dynamics.rotor_maps import rotor_thrust, rotor_torque
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN


@compiled
def rotor_wrench(m: Array, maps: Array, decay: float, row: int) -> None:
    """Write thrust, moments and spin momentum of all rotors into row `row` of `P.rotors`.

    The drives follow their target exponentially; `decay` is what is left of the gap to it.
    Moments are about the centre of gravity: arm times thrust, and the torque that turns each rotor
    (drag and acceleration) reacting on the body against its spin. Row 0, the start of the tick,
    also sets the thrust and torque of each rotor.
    """
    thrust = 0.0
    mx = 0.0
    my = 0.0
    mz = 0.0
    momentum = 0.0
    arm = m[V.arm_length]
    inertia = m[V.rotor_inertia]
    pull = inertia / m[P.inertial + 4]
    for i in range(4):
        gap = (m[P.target + i] - m[P.speed + i]) * decay
        speed = m[P.target + i] - gap
        t = m[P.efficiency + i] * rotor_thrust(maps, speed)
        q = m[P.efficiency + i] * rotor_torque(maps, speed)
        if row == 0:
            m[P.thrust + i] = t
            m[P.torque + i] = q
        thrust += t
        mx += (arm * ARM_Y[i] - m[P.inertial + 6]) * t
        my -= (arm * ARM_X[i] - m[P.inertial + 5]) * t
        mz -= SPIN[i] * (q + pull * gap)
        momentum += SPIN[i] * inertia * speed
    out = P.rotors + 5 * row
    m[out] = thrust
    m[out + 1] = mx
    m[out + 2] = my
    m[out + 3] = mz
    m[out + 4] = momentum


@compiled
def advance_rotor_speeds(m: Array) -> None:
    """Carry the rotor speeds to the end of the tick."""
    for i in range(4):
        target = m[P.target + i]
        m[P.speed + i] = target + (m[P.speed + i] - target) * m[P.inertial + 9]

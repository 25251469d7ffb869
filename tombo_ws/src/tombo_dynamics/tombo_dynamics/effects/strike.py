"""A blade meets the obstacle: the nodus folds, thrust is lost and comes back, the blade wears."""

from __future__ import annotations

import math
from tombo_dynamics.disc import disc_and_pole
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Array, P, V
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN

_FULL_STRIKE = 7.5
"""J: kinetic energy of a rotor in hover, 0.5 * 6.5e-5 kg m^2 * (480 rad/s)^2."""
_FOLD_TIME = 0.004
"""s: a blade folds within a quarter turn at hover speed (90 deg at 400 rad/s)."""
_REACH = 0.95
"""The recovery time of Table III is read as the time until 95 % of the thrust is back."""
_RECOVERY_CONSTANTS = -math.log(1.0 - _REACH ** (1.0 / 3.0))
"""Recovery time in time constants of the fold: thrust goes with (1 - fold)^3, see below."""


@compiled
def strike_rotor(m: Array, i: int, peak_force: float) -> None:
    """Fold rotor `i` if its blade reaches the obstacle, and add the wrench of the strike.

    The hub takes the rim's force; the torque about the axis goes into the rotor's momentum.
    """
    hx = m[V.arm_length] * ARM_X[i]
    hy = m[V.arm_length] * ARM_Y[i]
    hz = m[V.rotor_height]
    distance, ex, ey = disc_and_pole(m, hx, hy, hz)
    unfolded = 1.0 - m[P.fold + i]
    tip = m[V.nodus_radius] + (m[V.rotor_radius] - m[V.nodus_radius]) * unfolded
    if distance >= tip + m[P.obstacle + 2]:
        return
    dt = m[P.clock + 1]
    to_stop = m[V.rotor_inertia] * m[P.speed + i] / (tip * dt)
    force = min(peak_force * unfolded, to_stop)
    before = m[P.speed + i]
    after = before - force * tip * dt / m[V.rotor_inertia]
    m[P.speed + i] = after
    m[P.energy + i] += 0.5 * m[V.rotor_inertia] * (before * before - after * after)
    m[P.fold + i] = min(1.0, m[P.fold + i] + dt / _FOLD_TIME)
    fx = SPIN[i] * ey * force
    fy = -SPIN[i] * ex * force
    m[P.strike] += fx
    m[P.strike + 1] += fy
    m[P.strike + 3] -= hz * fy
    m[P.strike + 4] += hz * fx
    m[P.strike + 5] += hx * fy - hy * fx
    m[P.contact] = 1.0
    m[P.contact + 1] = i
    rx = hx + ex * min(distance, tip)
    ry = hy + ey * min(distance, tip)
    r = P.rotation
    for k in range(3):
        m[P.contact + 5 + k] = (
            m[P.body + k] + m[r + 3 * k] * rx + m[r + 3 * k + 1] * ry + m[r + 3 * k + 2] * hz
        )


@effect(
    "blade_strike",
    Stage.ROTOR,
    [
        Param("peak_force", "N", 0.0, (0.0, 1000.0), "collision force at the rim (Table III)", 145.5),
        Param("recovery_time", "s", 0.0, (0.0, 5.0), "until 95 % of thrust is back", 0.42),
    ],
    signature="one corner's thrust and speed collapse within milliseconds and return within half "
    "a second, with a push along the rim and a kick in yaw",
    separates_from={"weak_propeller": "a weak propeller does not recover"},
)
def blade_strike(
    m: Array, noise: Array, peak_force: float, recovery_time: float
) -> None:
    """Fold the blades of a disc that cuts the obstacle, and let folded ones straighten.

    The rim is pushed against the blade's motion with the measured peak force, fading as the nodus
    folds, until the rotor's momentum is spent: what the rotor loses the vehicle gets. The folded
    share f lowers the speed that the drive reaches to (1 - f) of the command, and thrust at a given
    speed to (1 - f): thrust goes with (1 - f)^3, and f decays so that 95 % are back after the
    recovery time. A blade whose damage has reached 1 never comes back.
    """
    dt = m[P.clock + 1]
    for i in range(4):
        if m[P.damage + i] >= 1.0:
            m[P.fold + i] = 1.0
        elif m[P.fold + i] > 0.0:
            decay = _RECOVERY_CONSTANTS * dt / max(recovery_time, 1e-3)
            m[P.fold + i] *= max(0.0, 1.0 - decay)
            if m[P.fold + i] < 1e-4:
                m[P.fold + i] = 0.0
    if m[P.obstacle + 2] > 0.0:
        dx = m[P.obstacle] - m[P.body]
        dy = m[P.obstacle + 1] - m[P.body + 1]
        reach = m[V.arm_length] + 1.5 * m[V.rotor_radius] + m[P.obstacle + 2]
        if dx * dx + dy * dy < reach * reach:
            for i in range(4):
                if m[P.damage + i] < 1.0 and m[P.speed + i] > 20.0:
                    strike_rotor(m, i, peak_force)
    for i in range(4):
        m[P.efficiency + i] *= 1.0 - m[P.fold + i]


@effect(
    "propeller_wear",
    Stage.ROTOR,
    [
        Param(
            "collisions", "1", 0.0, (0.0, 1000.0),
            "full strikes at hover speed that tear a blade off (0: never)", 3.0,
        )
    ],
    signature="a corner's thrust does not come back after one of several strikes",
    separates_from={"weak_propeller": "a torn blade begins with a strike"},
)
def propeller_wear(m: Array, noise: Array, collisions: float) -> None:
    """Add a strike's energy to the damage; at 1 the blade is torn off.

    The paper: about three collisions a propeller (3 of them replaced in 10 trials). A strike that
    stops a rotor from hover speed counts as one collision, a lighter one by its energy.
    """
    for i in range(4):
        m[P.damage + i] += m[P.energy + i] / (_FULL_STRIKE * collisions)

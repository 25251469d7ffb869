"""A blade meets the obstacle: the nodus folds, thrust is lost and comes back, the blade wears."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.body_point import NO_INTERSECTION, disc_to_obstacle, hub
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotors import straightened
from tombo_dynamics.vectors import Vector, add, cross
from tombo_dynamics.vehicle import SPIN

_FULL_STRIKE = 6.9
"""J: 0.5 * 6.0e-5 kg m^2 * (480 rad/s)^2, a rotor near hover (1.3 kg hovers at 512 rad/s)."""
_TURNING = 20.0
"""rad/s: below this a blade rests against the obstacle and is not struck."""


@compiled
def hub_to_obstacle(plant: Plant, i: int) -> Vector:
    """Return distance [m] and direction from the hub of rotor `i` to the obstacle's axis."""
    return disc_to_obstacle(plant, hub(plant, i))


@compiled
def tip_radius(plant: Plant, i: int) -> float:
    """Return how far blade `i` reaches from its hub [m]: folded it ends at the nodus."""
    straight = 1.0 - plant.fold[i]
    return float(
        plant.vehicle.nodus_radius
        + (plant.vehicle.rotor_radius - plant.vehicle.nodus_radius) * straight
    )


@compiled
def push_rim(
    plant: Plant, i: int, force: float, slant: float, reach: float, ex: float, ey: float
) -> None:
    """Push blade `i` with `force` [N] at `reach` [m] towards (ex, ey), where the obstacle is.

    The push leans by `slant` from the radial direction, away from the obstacle, towards the one
    against the blade's motion. The hub takes the force; its torque about the axis slows the rotor,
    at most to a stop: then only the radial part is left.
    """
    tick = plant.tick_length
    before = plant.rotor_speed[i]
    lever = max(reach, plant.vehicle.nodus_radius)
    radial = force * math.cos(slant)
    along = min(force * math.sin(slant), plant.vehicle.rotor_inertia * before / (lever * tick))
    after = before - along * lever * tick / plant.vehicle.rotor_inertia
    plant.rotor_speed[i] = after
    plant.strike_energy[i] += 0.5 * plant.vehicle.rotor_inertia * (before * before - after * after)
    hx, hy, hz = hub(plant, i)
    push = (-radial * ex + SPIN[i] * ey * along, -radial * ey - SPIN[i] * ex * along, 0.0)
    plant.strike_force = add(plant.strike_force, push)
    plant.strike_moment = add(plant.strike_moment, cross((hx, hy, hz), push))
    plant.contact.touching = True
    plant.contact.rotor = i
    turn, position = plant.rotation, plant.state.position
    rx = hx + ex * reach
    ry = hy + ey * reach
    plant.contact.point = (
        position[0] + turn[0, 0] * rx + turn[0, 1] * ry + turn[0, 2] * hz,
        position[1] + turn[1, 0] * rx + turn[1, 1] * ry + turn[1, 2] * hz,
        position[2] + turn[2, 0] * rx + turn[2, 1] * ry + turn[2, 2] * hz,
    )


class StrikeState(Record):
    """Memory of a blade strike."""

    folding = field(
        "1", "the blade swings back after a strike, until it is folded: 0 or 1", 4, kind=int
    )


@effect(
    "blade_strike",
    Stage.ROTOR,
    [
        Param(
            "peak_force", "N", 0.0, (0.0, 1000.0), "collision force at the rim (Table III)", 145.5
        ),
        Param("recovery_time", "s", 0.0, (0.0, 5.0), "until 90 % of thrust is back", 0.42),
        Param("slant", "rad", 0.0, (0.0, 1.5708), "push leans from radial to tangential", 0.4),
        Param("duration", "s", 0.0, (0.0, 0.1), "from touch to folded; the push fades", 0.008),
    ],
    signature="one corner's thrust and speed collapse within milliseconds and return within half "
    "a second, with a push along the rim and a kick in yaw",
    separates_from={"weak_propeller": "a weak propeller does not recover"},
    state=StrikeState,
    contact=True,
    healthy_spread=0.0,
)
def blade_strike(
    plant: Plant,
    noise: Array,
    state: StrikeState,
    peak_force: float,
    recovery_time: float,
    slant: float,
    duration: float,
) -> None:
    """Fold the blades of a disc that cuts the obstacle, and let folded ones straighten.

    A blade that is struck swings back at the nodus within `duration`; meanwhile its rim is pushed
    with the measured peak force, fading as it folds: away from the obstacle, and by the slant
    against the blade's motion. (A blade enters a flat surface by some millimetres between two
    passes, which with friction makes about 0.4 rad; a thin post inside the disc makes pi/2.)

    A folded share f lowers the drive's speed to (1 - f) of the command, and thrust at a given
    speed to (1 - f). It decays so that 90 % of the thrust are back after the
    recovery time (`tombo_dynamics.rotors`). A straightening blade that reaches the obstacle is
    struck again. A blade whose damage has reached 1 is gone.
    """
    tick = plant.tick_length
    dx = plant.obstacle.x - plant.state.position[0]
    dy = plant.obstacle.y - plant.state.position[1]
    reach = plant.vehicle.arm_length + 1.5 * plant.vehicle.rotor_radius + plant.obstacle.radius
    near = plant.obstacle.radius > 0.0 and dx * dx + dy * dy < reach * reach
    for i in range(4):
        if plant.damage[i] >= 1.0:
            plant.fold[i] = 1.0
        elif plant.fold[i] > 0.0 and state.folding[i] == 0:
            plant.fold[i] = straightened(plant.fold[i], recovery_time, tick)
        if near and plant.damage[i] < 1.0:
            distance, ex, ey = hub_to_obstacle(plant, i)
            tip = tip_radius(plant, i)
            if distance < tip + plant.obstacle.radius and plant.rotor_speed[i] > _TURNING:
                state.folding[i] = 1
            if state.folding[i] == 1 and distance < NO_INTERSECTION:
                force = peak_force * (1.0 - plant.fold[i])
                push_rim(plant, i, force, slant, min(distance, tip), ex, ey)
        if state.folding[i] == 1:
            plant.fold[i] += tick / max(duration, tick)
            if plant.fold[i] >= 1.0:
                plant.fold[i] = 1.0
                state.folding[i] = 0
        plant.efficiency[i] *= 1.0 - plant.fold[i]


@effect(
    "propeller_wear",
    Stage.ROTOR,
    [
        Param(
            "collisions",
            "1",
            0.0,
            (0.0, 1000.0),
            "full strikes at hover speed that tear a blade off (0: never)",
            3.0,
        )
    ],
    signature="a corner's thrust does not come back after one of several strikes",
    separates_from={"weak_propeller": "a torn blade begins with a strike"},
    contact=True,
    healthy_spread=0.0,
)
def propeller_wear(plant: Plant, noise: Array, collisions: float) -> None:
    """Add a strike's energy to the damage; at 1 the blade is torn off.

    The paper: about three collisions a propeller (3 of them replaced in 10 trials). A strike that
    stops a rotor from hover speed counts as one collision, a lighter one by its energy.
    """
    if collisions <= 0.0:
        return
    for i in range(4):
        plant.damage[i] += plant.strike_energy[i] / (_FULL_STRIKE * collisions)

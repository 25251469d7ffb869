"""Forces that no effect describes: what a diagnosis has to call unknown.

They are not in the registry, so no scenario names them and no fit proposes them. Who wants one
sets it on the plant's memory. Without one they cost five comparisons a tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tombo_dynamics.effects.registry import Param
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.jit import compiled
from tombo_dynamics.params import check_number
from tombo_dynamics.plant import PLANT_SIZES, Array, P
from tombo_dynamics.vehicle import GRAVITY

_PARAMS = 6
_SET, _STATE = P.disturbance + 1, P.disturbance + 1 + _PARAMS
"""Parameters; state (9), all zero at first."""
_TETHER, _LOAD, _PERIODIC, _FADE, _DRY_FRICTION, _PUSH, _WALL, _YAW, _HYSTERESIS = range(1, 10)

_CORD_FREQUENCY, _CORD_DAMPING = 80.0, 0.3
"""[rad/s] and ratio of a load that bounces on its cord: stretched by 1.5 mm at rest."""
_SMOOTH_SPEED = 0.05
"""[m/s] below this dry drag fades."""
_FADED = 0.8
"""Of the thrust is the most that can fade."""


@dataclass(frozen=True)
class Disturbance:
    """A kind of disturbance."""

    id: int
    params: tuple[Param, ...]
    doc: str


_METRE = (-100.0, 100.0)
_TURN = (-math.pi, math.pi)

DISTURBANCES: dict[str, Disturbance] = {
    "tether": Disturbance(
        _TETHER,
        (
            Param("x", "m", 0.0, _METRE, "fixed end in map", 0.0),
            Param("y", "m", 0.0, _METRE, "fixed end in map", 0.0),
            Param("z", "m", 0.0, _METRE, "fixed end in map", 0.0),
            Param("length", "m", 0.0, (0.0, 100.0), "of the slack cord", 1.0),
            Param("stiffness", "N/m", 0.0, (0.0, 1000.0), "of the cord", 1.5),
        ),
        "Elastic cord from the centre of mass to a fixed point.",
    ),
    "slung_load": Disturbance(
        _LOAD,
        (
            Param("mass", "kg", 0.0, (0.001, 5.0), "of the load", 0.15),
            Param("length", "m", 0.0, (0.05, 10.0), "of the cord", 0.7),
        ),
        "Point mass on a cord below the centre of mass; it swings, and it may rest on the floor.",
    ),
    "periodic_push": Disturbance(
        _PERIODIC,
        (
            Param("amplitude", "N", 0.0, (0.0, 50.0), "of the push", 0.6),
            Param("frequency", "Hz", 0.0, (0.0, 50.0), "of the push", 0.7),
            Param("heading", "rad", 0.0, _TURN, "direction in map, from x to y", 0.6),
        ),
        "Horizontal force that goes to and fro in map.",
    ),
    "thrust_fade": Disturbance(
        _FADE,
        (Param("rate", "1/s", 0.0, (0.0, 1.0), "share of thrust lost per second", 0.004),),
        "Collective thrust is lost with the time since the start, at any voltage.",
    ),
    "dry_drag": Disturbance(
        _DRY_FRICTION,
        (Param("force", "N", 0.0, (0.0, 50.0), "whatever the speed", 0.5),),
        "Force of constant size against the velocity in the disc plane.",
    ),
    "body_push": Disturbance(
        _PUSH,
        (
            Param("x", "N", 0.0, (-50.0, 50.0), "forward", 0.5),
            Param("y", "N", 0.0, (-50.0, 50.0), "to the left", -0.3),
            Param("z", "N", 0.0, (-50.0, 50.0), "upward", 0.0),
        ),
        "Constant force in body axes, as of rotors that stand askew.",
    ),
    "wall_suction": Disturbance(
        _WALL,
        (
            Param("force", "N", 0.0, (0.0, 50.0), "at the wall", 2.0),
            Param("decay", "m", 0.5, (0.01, 10.0), "distance over which it falls to 37 %", 0.5),
            Param("place", "m", 0.0, _METRE, "of the wall, along its heading", 2.0),
            Param("heading", "rad", 0.0, _TURN, "from the origin to the wall", 0.0),
        ),
        "Horizontal force towards a wall, exponential in the distance.",
    ),
    "yaw_spring": Disturbance(
        _YAW,
        (
            Param("moment", "N m", 0.0, (0.0, 5.0), "at a quarter turn", 0.03),
            Param("heading", "rad", 0.0, _TURN, "at which it is slack", 1.0),
        ),
        "Yaw moment with the sine of the heading, as of a stiff cable.",
    ),
    "thrust_hysteresis": Disturbance(
        _HYSTERESIS,
        (Param("play", "N", 0.0, (0.0, 10.0), "half width of the loop", 0.4),),
        "Collective thrust trails its changes by a play: less when it rises than when it falls.",
    ),
}
"""Name → shape."""


def set_disturbance(m: Array, name: str, *values: float) -> None:
    """Let a disturbance act on the plant `m` from its present state on.

    Args:
        m: the plant's memory, at the start of a tick.
        name: one of `DISTURBANCES`.
        values: its parameters in order; without any, the typical ones.

    Raises:
        InputError: an unknown name, too many or too few parameters, or one out of bounds.
    """
    if name not in DISTURBANCES:
        raise unknown_name("disturbance", name, DISTURBANCES)
    shape = DISTURBANCES[name]
    given = values or tuple(p.typical for p in shape.params)
    if len(given) != len(shape.params):
        raise InputError(
            f"disturbance '{name}': {len(given)} parameters; accepted: "
            + ", ".join(f"{p.name} [{p.unit}]" for p in shape.params)
        )
    m[P.disturbance : P.disturbance + PLANT_SIZES.disturbance] = 0.0
    for i, (p, value) in enumerate(zip(shape.params, given, strict=True)):
        m[_SET + i] = check_number(f"disturbance.{name}.{p.name}", value, p.unit, p.bounds)
    m[P.disturbance] = shape.id
    if shape.id == _LOAD:
        m[_STATE : _STATE + 6] = m[P.body : P.body + 6]
        m[_STATE + 2] = max(m[P.body + 2] - m[_SET + 1], 0.0)


@compiled
def prepare_disturbance(m: Array) -> None:
    """Carry the disturbance's own state over the tick, before its first slope is taken."""
    shape = m[P.disturbance]
    if shape == _LOAD:
        _swing(m)
    elif shape == _HYSTERESIS:
        thrust = m[P.rotors]
        m[_STATE] = min(max(m[_STATE], thrust - m[_SET]), thrust + m[_SET])


@compiled
def _swing(m: Array) -> None:
    """Move the load under gravity and cord; the cord's pull stays for the tick, for both ends.

    State: position and velocity of the load, pull on the vehicle, all in map. The vehicle gets the
    very force that the load feels, so momentum is kept.
    """
    mass = m[_SET]
    s, b, h = _STATE, P.body, m[P.clock + 1]
    x, y, z = m[s] - m[b], m[s + 1] - m[b + 1], m[s + 2] - m[b + 2]
    distance = max(math.sqrt(x * x + y * y + z * z), 1e-9)
    x, y, z = x / distance, y / distance, z / distance
    parting = x * (m[s + 3] - m[b + 3]) + y * (m[s + 4] - m[b + 4]) + z * (m[s + 5] - m[b + 5])
    stretch = distance - m[_SET + 1]
    pull = 0.0
    if stretch > 0.0:
        stiff = mass * _CORD_FREQUENCY * _CORD_FREQUENCY
        damp = 2.0 * _CORD_DAMPING * mass * _CORD_FREQUENCY
        pull = max(0.0, stiff * stretch + damp * parting)
    m[s + 6], m[s + 7], m[s + 8] = pull * x, pull * y, pull * z
    m[s + 3] -= h * pull * x / mass
    m[s + 4] -= h * pull * y / mass
    m[s + 5] -= h * (pull * z / mass + GRAVITY)
    if m[s + 2] <= 0.0 and m[s + 5] <= 0.0:  # it lies on the floor
        m[s + 3] = m[s + 4] = m[s + 5] = 0.0
    for i in range(3):
        m[s + i] += h * m[s + 3 + i]
    m[s + 2] = max(m[s + 2], 0.0)


@compiled
def disturb(m: Array, row: int) -> None:
    """Add the disturbance to `wrench`; `row` as in `rigid_body.derivative`."""
    shape = m[P.disturbance]
    p, b, r, f = _SET, P.body, P.rotation, P.wrench
    x = y = z = 0.0  # force in map
    if shape == _TETHER:
        x, y, z = m[p] - m[b], m[p + 1] - m[b + 1], m[p + 2] - m[b + 2]
        distance = math.sqrt(x * x + y * y + z * z)
        pull = m[p + 4] * max(distance - m[p + 3], 0.0) / max(distance, 1e-9)
        x, y, z = pull * x, pull * y, pull * z
    elif shape == _LOAD:
        x, y, z = m[_STATE + 6], m[_STATE + 7], m[_STATE + 8]
    elif shape == _PERIODIC:
        time = (m[P.clock] + 0.5 * row) * m[P.clock + 1]
        push = m[p] * math.sin(2.0 * math.pi * m[p + 1] * time)
        x, y = push * math.cos(m[p + 2]), push * math.sin(m[p + 2])
    elif shape == _FADE:
        time = (m[P.clock] + 0.5 * row) * m[P.clock + 1]
        m[f + 2] -= min(m[p] * time, _FADED) * m[P.rotors + 5 * row]
    elif shape == _DRY_FRICTION:
        u, v = m[P.flow], m[P.flow + 1]
        size = m[p] / math.sqrt(u * u + v * v + _SMOOTH_SPEED * _SMOOTH_SPEED)
        m[f] -= size * u
        m[f + 1] -= size * v
    elif shape == _PUSH:
        m[f] += m[p]
        m[f + 1] += m[p + 1]
        m[f + 2] += m[p + 2]
    elif shape == _WALL:
        ex, ey = math.cos(m[p + 3]), math.sin(m[p + 3])
        gap = max(m[p + 2] - ex * m[b] - ey * m[b + 1], 0.0)
        pull = m[p] * math.exp(-gap / m[p + 1])
        x, y = pull * ex, pull * ey
    elif shape == _YAW:
        m[f + 5] -= m[p] * math.sin(math.atan2(m[r + 3], m[r]) - m[p + 1])
    elif shape == _HYSTERESIS:
        m[f + 2] += m[_STATE] - m[P.rotors]
    m[f] += m[r] * x + m[r + 3] * y + m[r + 6] * z
    m[f + 1] += m[r + 1] * x + m[r + 4] * y + m[r + 7] * z
    m[f + 2] += m[r + 2] * x + m[r + 5] * y + m[r + 8] * z

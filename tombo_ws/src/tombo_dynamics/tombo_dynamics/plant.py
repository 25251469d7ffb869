"""The memory of one simulated vehicle: one flat array `m`, and the index of each of its parts.

One array is what compiled code takes fastest, and it makes a vehicle cheap to copy and to batch.
`m[P.body + 2]` is the height, `m[V.mass]` the nominal mass; Python code uses `part(m, "body")`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.params import as_tuple, tuple_type
from tombo_dynamics.vehicle import VehicleParams

Array = NDArray[np.float64]

DELAY_TICKS = 64
"""Length of the ring of past commands: delays up to 63 ms."""


class _Plant(NamedTuple):
    """Index of the first element of each part. `map` is ENU, body is FLU, SI units."""

    body: int
    """13: position and velocity in map, quaternion xyzw (map from body), body rates."""
    speed: int
    """4: rotor speeds [rad/s], positive whatever the direction of spin."""
    thrust: int
    """4: rotor thrusts [N]."""
    torque: int
    """4: aerodynamic drag torques of the rotors [N m], positive."""
    efficiency: int
    """4: factor on thrust and torque in this tick (1: the map's own)."""
    fold: int
    """4: 0 blade straight, 1 blade folded back at the nodus."""
    folding: int
    """4: 1 while a blade swings back after a strike, until it is folded."""
    damage: int
    """4: 0 new; at 1 the blade tears off."""
    command: int
    """4: rotor speeds last asked for [rad/s]."""
    target: int
    """4: rotor speeds that the drives work towards in this tick [rad/s]."""
    strike: int
    """6: force [N] and moment [N m] of blade strikes in this tick, body frame."""
    energy: int
    """4: kinetic energy that each rotor lost to strikes in this tick [J]."""
    contact: int
    """8: touching (0/1), rotor (-1: frame), force on the frame in map (3), point in map (3)."""
    inertial: int
    """15: mass, Ixx, Iyy, Izz, motor time constant, centre of gravity x, y, z in body, what is
    left of a gap to the target after half a tick and after a whole one; the inverses of the first
    four; the height above which nothing touches the floor [m]."""
    wind: int
    """3: velocity of the air in map [m/s] in this tick."""
    gust: int
    """3: state of the gust filter [m/s]."""
    supply: int
    """3: charge used [A h], current [A], voltage [V]."""
    wrench: int
    """6: forces [N] and moments [N m] on the centre of mass, body frame, gravity left out."""
    rotation: int
    """9: rotation matrix map from body, row-major, of the state in `body`."""
    flow: int
    """3: velocity of the vehicle through the air, body frame [m/s]."""
    rotors: int
    """15: thrust, moments x, y, z and spin momentum of all rotors at start, middle and end of
    the tick."""
    imu: int
    """6: gyro [rad/s] and specific force [m/s^2], body frame, as measured."""
    mocap: int
    """11: position (3), quaternion (4), latency [s], dropped (0/1), rest of a dropout [s], error
    of the stamp [s]."""
    draws: int
    """8: standard normal numbers drawn once a flight."""
    obstacle: int
    """4: vertical cylinder: x, y, radius, height of its top, in map [m]; radius 0: none."""
    clock: int
    """2: ticks since the start, length of a tick [s]."""
    delay: int
    """256: the rotor speeds asked for in the last 64 ticks, a ring."""
    work: int
    """39: the integrator's scratch: state at the start of the tick, slopes, latest slope."""
    disturbance: int
    """16: shape (0: none), parameters (6), state (9); see `tombo_dynamics.disturbance`."""


PLANT_SIZES = _Plant(
    13,
    4,
    4,
    4,
    4,
    4,
    4,
    4,
    4,
    4,
    6,
    4,
    8,
    15,
    3,
    3,
    3,
    6,
    9,
    3,
    15,
    6,
    11,
    8,
    4,
    2,
    4 * DELAY_TICKS,
    39,
    16,
)


def _starts(sizes: tuple[int, ...], first: int = 0) -> list[int]:
    starts = [first]
    for size in sizes:
        starts.append(starts[-1] + size)
    return starts


_PLANT_STARTS = _starts(PLANT_SIZES)
P = _Plant(*_PLANT_STARTS[:-1])
"""Where each part of the plant begins in `m`."""
VehicleIndex: Any = tuple_type(VehicleParams, "VehicleIndex", __name__)
V: Any = VehicleIndex(*range(_PLANT_STARTS[-1], _PLANT_STARTS[-1] + len(VehicleIndex._fields)))
"""Where each vehicle parameter is in `m`."""
SLOPES = P.work + 13
"""d(body)/dt (13) after `begin_tick`: at the start of the tick."""
ANGULAR_ACCELERATION = SLOPES + 10
"""d(body rates)/dt (3) [rad/s^2] at the start of the tick."""
PLANT_SIZE = _PLANT_STARTS[-1] + len(VehicleIndex._fields)


def new_plant(vehicle: VehicleParams) -> Array:
    """Return the memory of a vehicle at the origin, upright, everything else zero."""
    memory = np.zeros(PLANT_SIZE)
    memory[P.body + 9] = 1.0
    memory[_PLANT_STARTS[-1] :] = as_tuple(vehicle, VehicleIndex)
    return memory


def part(memory: Array, name: str) -> Array:
    """Return a view of a named part of a plant's memory."""
    start = getattr(P, name)
    view: Array = memory[start : start + getattr(PLANT_SIZES, name)]
    return view

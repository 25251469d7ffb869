"""The records of the compiled flight, and its parts besides the cores.

`tombo_sim.flight_loop` has the loop over them and all cores.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from tombo_control.autopilot import Autopilot
from tombo_control.controller_core import ControllerMemory
from tombo_control.estimator_core import EstimatorMemory
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Phase
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import upright
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vectors import store
from tombo_sim.ground_truth import UNDECIDED, FlightEnd, contact_force, watch_end


class LogRow(Record):
    """Truth, then what the autopilot knew and wanted. Map is ENU, body FLU."""

    position = field("m", "map", 3)
    velocity = field("m/s", "map", 3)
    attitude = field("1", "quaternion xyzw, map from body", 4)
    rates = field("rad/s", "body", 3)
    rotor_speed = field("rad/s", "of each rotor", 4)
    rotor_thrust = field("N", "of each rotor", 4)
    fold = field("1", "0: blade straight, 1: folded back", 4)
    damage = field("1", "0: new, 1: torn off", 4)
    contact_force = field("N", "of the obstacle on blades and frame, map", 3)
    contact = field("", "touching (0/1), rotor (-1: frame), point in map [m] (3)", 5)
    gyro = field("rad/s", "as measured, body", 3)
    accel = field("m/s^2", "specific force as measured, body", 3)
    est_position = field("m", "estimated, map", 3)
    est_velocity = field("m/s", "estimated, map", 3)
    est_attitude = field("1", "estimated quaternion xyzw", 4)
    position_setpoint = field("m", "map", 3)
    velocity_setpoint = field("m/s", "what the reference feeds forward, map", 3)
    acceleration_setpoint = field("m/s^2", "what the reference feeds forward, map", 3)
    attitude_setpoint = field("1", "quaternion xyzw", 4)
    rates_setpoint = field("rad/s", "body", 3)
    thrust_setpoint = field("N", "collective", 1)
    rotor_command = field("rad/s", "of each rotor", 4)
    mode = field("1", "phase of the set point, or blind", 1)
    wind = field("m/s", "velocity of the air, map", 3)
    battery = field("", "charge used [A h], current [A], voltage [V]", 3)


Log = namedtuple("Log", list(LogRow.fields))  # type: ignore[misc]
"""Flight log: one array per `LogRow` field, one row per tick."""


FIGURE_COLUMNS = (
    "position", "velocity", "attitude", "rates", "fold", "damage", "contact_force", "contact",
    "position_setpoint", "mode",
)  # fmt: skip
"""Columns for the figures of a flight; without the others a flight takes a tenth less time."""
_STAGGER = 8
"""Numbers, of 8 bytes: a line of cache."""


def new_log(ticks: int, columns: Collection[str] = Log._fields) -> Any:
    """Return an empty `Log`, each column contiguous; columns outside of `columns` have no rows.

    A tick writes all columns, so they start at different offsets of their memory pages: the first
    cache of a processor holds few lines of the same offset.
    """
    shapes = [
        (ticks if name in columns else 0, *column.shape) for name, column in LogRow.fields.items()
    ]
    sizes = [-(-math.prod(shape) // 512) * 512 + _STAGGER for shape in shapes]
    pieces = np.split(np.zeros(sum(sizes)), np.cumsum(sizes)[:-1])
    return Log(
        *(
            piece[: math.prod(shape)].reshape(shape)
            for piece, shape in zip(pieces, shapes, strict=True)
        )
    )


def part_of(log: Any, ticks: slice) -> Any:
    """Return rows of a `Log`: views."""
    return Log(*(column[ticks] for column in log))


class FlightProgress(Record):
    """Where a flight stands."""

    tick = field("1", "the next one to fly", kind=int)
    end = field("1", "first tick not to fly", kind=int)
    phase = field("1", "the mission's, as published", kind=int)
    over = field("", "whether it is over", kind=FlightEnd)
    python_step = field(
        "1", "the reaction is to be stepped in Python, in the last tick", kind=bool
    )
    python_input = field("1", "events are to be handed to it there", kind=bool)


class ImuReading(NamedTuple):
    """The IMU sample of a tick as a message; its arrays are the plant's."""

    stamp_ns: int
    gyro: Array
    """(3) [rad/s], base_link."""
    accel: Array
    """(3) [m/s^2], base_link."""


class Flights(NamedTuple):
    """N flights; each array has them along its first axis."""

    plant: Any
    theta: Array
    """(N, P) parameters of the effects."""
    noise: Array
    """(N, B, 9) standard normals, a row a tick."""
    base: Any
    """(N) tick of its first row."""
    capture_ticks: Any
    """(N, M) at which poses are captured."""
    mocap_noise: Array
    """(N, M, 9) standard normals."""
    entries: Any
    """(N, M) `MocapEntry`."""
    captures: Any
    """(N) `Captures`."""
    memories: tuple[tuple[Any, ...], ...]
    """Of each core, each (N)."""
    published: tuple[Any, ...]
    """A table a topic, `flight_loop.TABLES`: (N, rows) of tick and message."""
    counts: Any
    """(N, tables) rows in use."""
    there: Any
    """(N, tables) rows that are there in the tick."""
    fresh: Any
    """(N, tables) the first of them that were not in the tick before."""
    waiting: Any
    """(N, tables) the first that wait for the mission's next step."""
    progress: Any
    """(N) `FlightProgress`."""


class Shared(NamedTuple):
    """Data shared by N flights."""

    maps: Any
    """(1) the rotor's table."""
    params: tuple[tuple[Any, ...], ...]
    """Of each core, each (1, ...)."""
    log: Any
    """`Log`, a row is written for every tick that it has room for: of one flight."""


@compiled(counted=False)
def update_end_conditions(plant: Plant, flight: FlightProgress) -> None:
    """Set `end` of the flight once a landing or a crash decides it."""
    state = plant.state
    after = watch_end(flight.over, state.position[2], upright(state.attitude), flight.phase)
    if after != UNDECIDED:
        flight.end = min(flight.end, flight.tick + int(after / TICK_S + 0.5))


@compiled(counted=False)
def write_row(
    plant: Plant,
    estimator: EstimatorMemory,
    controller: ControllerMemory,
    autopilot: Autopilot,
    log: Any,
    tick: int,
) -> None:
    """Write the tick into its row of the `Log`; `autopilot` is the controller's."""
    contact, supply, state = plant.contact, plant.supply, plant.state
    estimate, setpoint, reference = estimator.estimate, autopilot.setpoint, controller.setpoint
    # all columns side by side: one column after the other costs 4 % of a flight's time
    for i in range(3):
        log.position[tick, i] = state.position[i]
        log.velocity[tick, i] = state.velocity[i]
        log.rates[tick, i] = state.rates[i]
        log.position_setpoint[tick, i] = reference.position[i]
        log.contact[tick, 2 + i] = contact.point[i]
        log.contact_force[tick, i] = 0.0
    for i in range(4):
        log.attitude[tick, i] = state.attitude[i]
        log.fold[tick, i] = plant.fold[i]
        log.damage[tick, i] = plant.damage[i]
    if contact.touching:
        store(log.contact_force[tick], contact_force(plant))
    log.contact[tick, 0] = contact.touching
    log.contact[tick, 1] = contact.rotor
    log.mode[tick, 0] = (
        Phase.DESCEND_BLIND if autopilot.mode_flown == Phase.DESCEND_BLIND else reference.phase
    )
    if tick >= log.gyro.shape[0]:  # `FIGURE_COLUMNS` alone
        return
    for i in range(3):
        log.gyro[tick, i] = plant.gyro[i]
        log.accel[tick, i] = plant.accel[i]
        log.velocity_setpoint[tick, i] = reference.velocity[i]
        log.acceleration_setpoint[tick, i] = reference.acceleration[i]
        log.rates_setpoint[tick, i] = setpoint.rates[i]
        log.wind[tick, i] = plant.wind[i]
        log.est_position[tick, i] = estimate.position[i] if estimator.known else math.nan
        log.est_velocity[tick, i] = estimate.velocity[i] if estimator.known else math.nan
    for i in range(4):
        log.rotor_speed[tick, i] = plant.rotor_speed[i]
        log.rotor_thrust[tick, i] = plant.rotor_thrust[i]
        log.attitude_setpoint[tick, i] = setpoint.attitude[i]
        log.rotor_command[tick, i] = plant.rotor_command[i]
        log.est_attitude[tick, i] = estimate.attitude[i] if estimator.known else math.nan
    log.battery[tick, 0] = supply.charge
    log.battery[tick, 1] = supply.current
    log.battery[tick, 2] = supply.voltage
    log.thrust_setpoint[tick, 0] = setpoint.thrust

"""The compiled flight: plant, sensors and the five cores, tick by tick.

In each tick the simulator senses. Each core takes the messages of the tick before, in the order of
its `inputs`. It is stepped if its period is due or a message has come. The rotor command acts in
the same tick. Where the reaction decides in Python, the tick ends without the reaction's step.

The cores' Python classes call the same functions. `tombo_flight.run_wiring` flies the same flight
in plain Python, nodes in lockstep over DDS; a test compares the three bit by bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll

from tombo_collision.detector_core import take_pose as detect
from tombo_collision.reaction_core import (
    decides_in_python,
    reaction_step,
    take_detector_status,
    take_mission_setpoint,
)
from tombo_collision.reaction_core import take_odometry as react_to_odometry
from tombo_collision.reaction_core import take_pose as react_to_pose
from tombo_control.controller_core import take_biases, take_setpoint
from tombo_control.controller_core import take_imu as control
from tombo_control.controller_core import take_odometry as control_odometry
from tombo_control.estimator_core import fill_odometry, fill_status, take_phase
from tombo_control.estimator_core import take_imu as predict
from tombo_control.estimator_core import take_pose as correct
from tombo_control.mission_core import step_mission, take_answer, take_reaction
from tombo_control.mission_core import take_odometry as plan_odometry
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import Compiled, Core, Output, as_row, field_of
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.rigid_body import finish_tick
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_sim.kernel import (
    FlightProgress,
    Flights,
    ImuReading,
    Shared,
    new_log,
    update_end_conditions,
    write_row,
)
from tombo_sim.sensing import Captures, MocapEntry, capture_pose, next_arrival, read_imu
from tombo_sim.wiring import CORES, POSE, SENSORS

ESTIMATOR, DETECTOR, REACTION, MISSION, CONTROLLER = range(5)
"""Places in `CORES`."""
TABLES: dict[str, Output] = {POSE: SENSORS[POSE]} | {
    topic: output for core in CORES for topic, output in core.outputs.items() if not output.logged
}
"""Topics of which a flight keeps the messages, in the order of `Flights.published`."""
_INDEX = {topic: k for k, topic in enumerate(TABLES)}
"""Topic → place of its table in `TABLES` and in `Flights.published`."""
_POSE, _ODOMETRY, _BIASES = (_INDEX[t] for t in (POSE, "/odometry", "/estimator/status"))
COLLISION, _DETECTOR = (_INDEX[t] for t in ("/collision_event", "/detector/status"))
_ANSWER, _REACTION = (_INDEX[t] for t in ("/setpoint", "/reaction/status"))
_PLANNED, _PHASE = (_INDEX[t] for t in ("/mission/setpoint", "/mission/status"))
CONTACT = _INDEX["/contact_event"]
_REACTION_NS, _MISSION_NS = CORES[REACTION].period_ns, CORES[MISSION].period_ns
_SPARE = 64
"""Rows that a table has besides."""


# --- The tick ----------------------------------------------------------------------------------


class Mail(NamedTuple):
    """The messages of one flight. Arrays but `tables` have an element a table."""

    tables: Any
    """Of N flights, as `Flights.published`."""
    i: int
    """The flight."""
    counts: Any
    """Rows in use."""
    there: Any
    """Rows that are there in the tick: those of the ticks before."""
    fresh: Any
    """The first row that was not there in the tick before."""
    waiting: Any
    """The first row that waits for the mission's next step."""


@compiled(counted=False)
def fly(flights: Flights, shared: Shared, i: int, stop: int) -> bool:
    """Fly `flights` i until tick `stop`, its end, or a step to make in Python: then True."""
    # records are handed over: of a row of an array each field's address would be worked out apart
    estimator, estimator_autopilot = flights.memories[ESTIMATOR]
    controller, autopilot = flights.memories[CONTROLLER]
    mission_params, waypoints, mission_limits = shared.params[MISSION]
    maps, controller_limits = shared.params[CONTROLLER]
    mail = Mail(
        flights.published, i, flights.counts[i], flights.there[i], flights.fresh[i],
        flights.waiting[i],
    )  # fmt: skip
    return fly_ticks(
        flights.plant[i], shared.maps[0], flights.theta[i], flights.noise[i], flights.base[i],
        flights.capture_ticks[i], flights.mocap_noise[i], flights.entries[i], flights.captures[i],
        flights.progress[i], shared.log,
        mail,
        estimator[i], estimator_autopilot[i],
        flights.memories[DETECTOR][0][i], shared.params[DETECTOR][0][0],
        flights.memories[REACTION][0][i], shared.params[REACTION][0][0],
        flights.memories[MISSION][0][i], mission_params[0], waypoints[0], mission_limits[0],
        controller[i], autopilot[i], maps[0], controller_limits[0],
        stop,
    )  # fmt: skip


@compiled(inline=False, counted=False)
def fly_ticks(
    plant: Any, rotor: Any, theta: Array, tick_noise: Array, base: int,
    capture_ticks: Any, mocap_noise: Array, entries: Any, captures: Any,
    flight: Any, log: Any,
    mail: Mail,
    estimator: Any, estimator_autopilot: Any,
    detector: Any, detector_params: Any,
    reaction: Any, reaction_limits: Any,
    mission: Any, mission_params: Any, waypoints: Any, mission_limits: Any,
    controller: Any, autopilot: Any, maps: Any, controller_limits: Any,
    stop: int,
) -> bool:  # fmt: skip
    """Fly one flight; the arguments are rows of `Flights` and `Shared`."""
    flight.python_step = False
    flight.python_input = False
    counts, there, fresh = mail.counts, mail.there, mail.fresh
    while flight.tick < min(stop, flight.end):
        tick = flight.tick
        now = EPOCH_NS + tick * TICK_NS
        noise = tick_noise[tick - base]
        for k in range(counts.size):
            fresh[k] = there[k]
            there[k] = counts[k]

        read_imu(plant, rotor, noise, theta)
        imu = ImuReading(now, plant.gyro, plant.accel)
        if tick == capture_ticks[captures.next]:
            capture_pose(plant, mocap_noise, theta, entries, captures, tick)
        arrived = next_arrival(entries, captures, tick)
        while arrived >= 0:
            _publish_pose(entries[arrived], mail.tables[_POSE], mail, tick)
            arrived = next_arrival(entries, captures, tick)
        there[_POSE] = counts[_POSE]  # a measurement is there in its tick
        for row in range(fresh[_PHASE], there[_PHASE]):
            flight.phase = mail.tables[_PHASE][mail.i, row].message.phase
        update_end_conditions(plant, flight)

        _step_estimator(estimator, estimator_autopilot, imu, mail, tick, now)
        _step_detector(detector, detector_params, mail, tick, now)
        _step_reaction(reaction, reaction_limits, flight, mail, tick, now)
        if now % _MISSION_NS == 0:
            _step_mission(mission, mission_params, waypoints, mission_limits, mail, tick, now)
        _step_controller(controller, autopilot, maps, controller_limits, imu, mail, tick, now)

        plant.rotor_command = controller.command.speed
        if 0 <= tick < log.position.shape[0]:  # 0: no index is counted from the end
            write_row(plant, estimator, controller, autopilot, log, tick)
        finish_tick(plant, noise, theta)
        flight.tick = tick + 1
        if flight.python_step:
            return True
    return False


@compiled(counted=False)
def _news(mail: Mail, k: int) -> int:
    """Return how many messages of table k have come."""
    return int(mail.there[k] - mail.fresh[k])


@compiled(counted=False)
def _step_estimator(
    memory: Any, autopilot: Any, imu: Any, mail: Mail, tick: int, now: int
) -> None:
    tables, i = mail.tables, mail.i
    for row in range(mail.fresh[_PHASE], mail.there[_PHASE]):
        take_phase(memory, autopilot, tables[_PHASE][i, row].message, now)
    for row in range(mail.fresh[_POSE], mail.there[_POSE]):
        correct(memory, autopilot, tables[_POSE][i, row].message, now)
        _publish_estimate(memory, mail, tick)
    predict(memory, autopilot, imu, now)
    _publish_estimate(memory, mail, tick)


@compiled(counted=False)
def _publish_estimate(memory: Any, mail: Mail, tick: int) -> None:
    tables, i = mail.tables, mail.i
    if memory.odometry_due:
        row = _new_row(tables[_ODOMETRY], mail, _ODOMETRY, tick)
        if row >= 0:
            fill_odometry(memory, tables[_ODOMETRY][i, row].message)
        memory.odometry_due = False
    if memory.status_due:
        row = _new_row(tables[_BIASES], mail, _BIASES, tick)
        if row >= 0:
            fill_status(memory, tables[_BIASES][i, row].message)
        memory.status_due = False


@compiled(counted=False)
def _step_detector(memory: Any, params: Any, mail: Mail, tick: int, now: int) -> None:
    tables, i = mail.tables, mail.i
    for row in range(mail.fresh[_POSE], mail.there[_POSE]):
        detect(memory, params, tables[_POSE][i, row].message, now)
        if memory.event_due:
            publish(memory.event, tables[COLLISION], mail, COLLISION, tick)
            memory.event_due = False
        if memory.status_due:
            publish(memory.status, tables[_DETECTOR], mail, _DETECTOR, tick)
            memory.status_due = False


@compiled(counted=False)
def _step_reaction(memory: Any, limits: Any, flight: Any, mail: Mail, tick: int, now: int) -> None:
    tables, i = mail.tables, mail.i
    for row in range(mail.fresh[_POSE], mail.there[_POSE]):
        react_to_pose(memory, limits, tables[_POSE][i, row].message, now)
    for row in range(mail.fresh[_DETECTOR], mail.there[_DETECTOR]):
        take_detector_status(memory, limits, tables[_DETECTOR][i, row].message, now)
    for row in range(mail.fresh[_ODOMETRY], mail.there[_ODOMETRY]):
        react_to_odometry(memory, limits, tables[_ODOMETRY][i, row].message, now)
    for row in range(mail.fresh[_PLANNED], mail.there[_PLANNED]):
        take_mission_setpoint(memory, limits, tables[_PLANNED][i, row].message, now)
    messages = (
        _news(mail, _POSE)
        + _news(mail, _DETECTOR)
        + _news(mail, _ODOMETRY)
        + _news(mail, _PLANNED)
    )
    events = _news(mail, COLLISION) + _news(mail, CONTACT)
    if events > 0:
        flight.python_input = True
        flight.python_step = True
    elif messages > 0 or now % _REACTION_NS == 0:
        if decides_in_python(memory, limits, now):
            flight.python_step = True
        else:
            reaction_step(memory, limits, now)
            _publish_reaction(memory, mail, tick)


@compiled(counted=False)
def _publish_reaction(memory: Any, mail: Mail, tick: int) -> None:
    tables = mail.tables
    if memory.publishes:
        publish(memory.setpoint, tables[_ANSWER], mail, _ANSWER, tick)
        memory.publishes = False
    if memory.status_due:
        publish(memory.status, tables[_REACTION], mail, _REACTION, tick)
        memory.status_due = False


@compiled(counted=False)
def _step_mission(
    memory: Any, params: Any, waypoints: Any, limits: Any, mail: Mail, tick: int, now: int
) -> None:
    tables, i = mail.tables, mail.i
    for row in range(mail.waiting[_ODOMETRY], mail.there[_ODOMETRY]):
        plan_odometry(memory, params, waypoints, limits, tables[_ODOMETRY][i, row].message, now)
    for row in range(mail.waiting[_REACTION], mail.there[_REACTION]):
        take_reaction(memory, params, waypoints, limits, tables[_REACTION][i, row].message, now)
    for row in range(mail.waiting[_ANSWER], mail.there[_ANSWER]):
        take_answer(memory, params, waypoints, limits, tables[_ANSWER][i, row].message, now)
    for k in range(mail.waiting.size):
        mail.waiting[k] = mail.there[k]
    step_mission(memory, params, waypoints, limits, now)
    if memory.setpoint_due:
        publish(memory.setpoint, tables[_PLANNED], mail, _PLANNED, tick)
        memory.setpoint_due = False
    if memory.status_due:
        publish(memory.status, tables[_PHASE], mail, _PHASE, tick)
        memory.status_due = False


@compiled(counted=False)
def _step_controller(
    memory: Any, autopilot: Any, maps: Any, limits: Any, imu: Any, mail: Mail, tick: int,
    now: int,
) -> None:  # fmt: skip
    tables, i = mail.tables, mail.i
    for row in range(mail.fresh[_ODOMETRY], mail.there[_ODOMETRY]):
        control_odometry(memory, autopilot, maps, limits, tables[_ODOMETRY][i, row].message, now)
    for row in range(mail.fresh[_BIASES], mail.there[_BIASES]):
        take_biases(memory, autopilot, maps, limits, tables[_BIASES][i, row].message, now)
    for row in range(mail.fresh[_ANSWER], mail.there[_ANSWER]):
        take_setpoint(memory, autopilot, maps, limits, tables[_ANSWER][i, row].message, now)
    control(memory, autopilot, maps, limits, imu, now)
    if memory.contact.due:
        publish(memory.event, tables[CONTACT], mail, CONTACT, tick)
        memory.contact.due = False


@compiled(inline=False, counted=False)
def publish(message: Any, table: Any, mail: Mail, k: int, tick: int) -> None:
    """Publish a message in table k; a full table takes none."""
    row = _new_row(table, mail, k, tick)
    if row >= 0:
        entry = table[mail.i, row]
        entry.message = message


@compiled(inline=False, counted=False)
def _publish_pose(sample: Any, table: Any, mail: Mail, tick: int) -> None:
    """Publish a captured pose in the tick in which it arrives."""
    row = _new_row(table, mail, _POSE, tick)
    if row >= 0:
        message = table[mail.i, row].message
        message.stamp_ns = EPOCH_NS + int(np.rint(sample.stamp * TICK_NS))
        message.position = sample.position
        message.attitude = sample.attitude


@compiled(inline=False, counted=False)
def _new_row(table: Any, mail: Mail, k: int, tick: int) -> int:
    """Return the row of table k for a new message; -1: the table is full."""
    row = int(mail.counts[k])
    if row == table.shape[1]:
        return -1
    entry = table[mail.i, row]
    entry.tick = tick
    mail.counts[k] = row + 1
    return row


@compiled(inline=False, counted=False)
def step_reaction(flights: Flights, shared: Shared, i: int) -> None:
    """Step the reaction of flight i, which was left to Python in the last tick."""
    tick = flights.progress[i].tick - 1
    memory, limits = flights.memories[REACTION][0][i], shared.params[REACTION][0][0]
    mail = Mail(
        flights.published, i, flights.counts[i], flights.there[i], flights.fresh[i],
        flights.waiting[i],
    )  # fmt: skip
    reaction_step(memory, limits, EPOCH_NS + tick * TICK_NS)
    _publish_reaction(memory, mail, tick)


@compiled(inline=False, counted=False)
def forget_messages(flights: Flights, i: int) -> None:
    """Drop the messages of flight i that all have taken: the mission takes them last."""
    counts, there, waiting = flights.counts[i], flights.there[i], flights.waiting[i]
    k = 0
    for table in literal_unroll(flights.published):
        rows, gone = table[i], waiting[k]
        if gone > 0:
            for row in range(counts[k] - gone):
                rows[row] = rows[gone + row]
        k += 1  # noqa: SIM113 - compiled code unrolls the loop
    for j in range(waiting.size):
        counts[j] -= waiting[j]
        there[j] -= waiting[j]
        waiting[j] = 0


# --- Flights in Python -------------------------------------------------------------------------


def _entry(output: Output) -> type[Record]:
    fields = {"tick": field("tick", "", kind=int), "message": field("", "", kind=output.layout)}
    return type("Entry", (Record,), fields)


_ENTRIES = [_entry(output) for output in TABLES.values()]


def new_published(count: int, ticks: int) -> tuple[Any, ...]:
    """Return empty tables for N flights of `ticks` ticks."""
    return tuple(
        np.zeros((count, ticks // output.every + _SPARE), entry.layout)
        for output, entry in zip(TABLES.values(), _ENTRIES, strict=True)
    )


def _compiled(core: Core) -> Compiled:
    """Return what compiled code uses of a core; nothing of a core in plain Python."""
    return core.compiled or Compiled((), (), {})


def memories_of(cores: Sequence[Core]) -> tuple[tuple[Any, ...], ...]:
    """Return the memories of each core, as arrays (1)."""
    return tuple(
        tuple(field_of(core, path).as_array() for path in _compiled(core).memories)
        for core in cores
    )


def params_of(cores: Sequence[Core]) -> tuple[tuple[Any, ...], ...]:
    """Return the parameters of each core, as arrays (1, ...)."""
    return tuple(
        tuple(as_row(field_of(core, path)) for path in _compiled(core).params) for core in cores
    )


def one_flight(
    plant: Record,
    theta: Array,
    captures: tuple[Any, Array],
    cores: Sequence[Core],
    published: tuple[Any, ...],
) -> Flights:
    """Return a flight at tick 0, without normals of the plant.

    Args:
        plant: the vehicle, as of `flight_setup.begin`.
        theta: (P) parameters of the effects.
        captures: (M) ticks of capture and (M, 9) standard normals.
        cores: those of the wiring.
        published: of `new_published`, for one flight.
    """
    ticks, normals = captures
    counts, there, fresh, waiting = np.zeros((4, 1, len(TABLES)), np.int64)
    return Flights(
        plant.as_array(),
        theta[None],
        np.zeros((1, 0, normals.shape[1])),
        np.zeros(1, np.int64),
        ticks[None],
        normals[None],
        np.zeros((1, ticks.size), MocapEntry.layout),
        np.zeros(1, Captures.layout),
        memories_of(cores),
        published,
        counts,
        there,
        fresh,
        waiting,
        np.zeros(1, FlightProgress.layout),
    )


def new_flights(
    count: int, plant: Any, theta: Array, cores: Sequence[Core], captures: int, block: int
) -> Flights:
    """Return N flights with room for `captures` poses and normals for `block` ticks."""
    template = one_flight(
        plant, theta, (np.zeros(captures, np.int64), np.zeros((captures, 9))), cores, ()
    )
    noise = np.zeros((1, block, template.noise.shape[2]))
    repeated = _repeated(template._replace(noise=noise), count)
    flights: Flights = repeated._replace(published=new_published(count, block))
    return flights


def _repeated(arrays: Any, count: int) -> Any:
    """Return zeros as arrays (1, ...), for each of N."""
    if isinstance(arrays, tuple):
        parts = [_repeated(part, count) for part in arrays]
        return type(arrays)(*parts) if hasattr(arrays, "_fields") else tuple(parts)
    return np.zeros((count, *arrays.shape[1:]), arrays.dtype)


def shared_by(maps: Record, cores: Sequence[Core], log: Any = None) -> Shared:
    """Return what flights share; without a log nothing is written down."""
    return Shared(maps.as_array(), params_of(cores), new_log(0) if log is None else log)


def hand_over(flights: Flights, i: int, reaction: Core) -> None:
    """Hand the reaction the events of flight i that are there in its last tick."""
    now_ns = EPOCH_NS + (int(flights.progress["tick"][i]) - 1) * TICK_NS
    fresh, there = flights.fresh[i], flights.there[i]
    for topic in reaction.inputs:
        if topic in _compiled(reaction).takes:
            continue
        k = _INDEX[topic]
        for row in range(int(fresh[k]), int(there[k])):
            event = flights.published[k][i, row]["message"]
            reaction.on(topic, TABLES[topic].message_of(event), now_ns)
        fresh[k] = there[k]


def step_in_python(flights: Flights, i: int, reaction: Core) -> None:
    """Make the step of flight i that was left to Python in its last tick."""
    tick = int(flights.progress["tick"][i]) - 1
    hand_over(flights, i, reaction)
    for topic, message in reaction.step(EPOCH_NS + tick * TICK_NS):
        _publish(flights, i, topic, message, tick)


def _publish(flights: Flights, i: int, topic: str, message: Any, tick: int) -> None:
    """Append a message, of `tombo_dynamics.messages`, to the topic's table of flight i.

    Compiled cores read it there in the next tick. Fields that only the record has stay 0.

    Raises:
        InputError: the table is full: the core publishes more often than it declares.
    """
    k = _INDEX[topic]
    row, table = int(flights.counts[i, k]), flights.published[k][i]
    if row >= table.size:
        raise InputError(
            f"{topic}: more than {row} messages; accepted: one in {TABLES[topic].every} ticks"
        )
    entry = table[row]
    entry["tick"] = tick
    for name in TABLES[topic].layout.fields:
        if hasattr(message, name):
            entry["message"][name] = getattr(message, name)
    flights.counts[i, k] = row + 1


def published_by(flights: Flights, i: int) -> dict[str, Any]:
    """Return the messages of the cores in flight i: topic → rows of tick and message.

    Topics whose content the log has are left out.

    Raises:
        InputError: a table was full.
    """
    published = {}
    for k, (topic, output) in enumerate(TABLES.items()):
        table, rows = flights.published[k][i], int(flights.counts[i, k])
        if rows >= table.size:
            raise InputError(
                f"{topic}: more than {rows} messages; accepted: one in {output.every} ticks"
            )
        if topic != POSE:
            published[topic] = table[:rows]
    return published

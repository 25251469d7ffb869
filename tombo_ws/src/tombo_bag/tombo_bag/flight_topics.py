"""The topics of a simulated flight, the same as those of the nodes in a live flight; and its file.

Measurements and published messages are unchanged; the rest follows from the log. Every stamp and
log time is the flight's own time plus `EPOCH_NS`, never the time of day: the same flight gives the
same bytes. The header's stamp is the time at which a value was true (for a pose of the motion
capture: its capture); the log time is the time at which it was known (its arrival).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import lay_in, lay_in_times, layout
from tombo_bag.flight import Flight, Topic
from tombo_bag.flight_time import FLIGHT_METADATA, nanoseconds
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.markers import GREEN, RED, obstacle_marker, point_marker
from tombo_bag.message_codec import CONSTANTS, FORMS, encoded
from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    BATTERY,
    IMU,
    MARKERS,
    MOCAP_POSE,
    RATES_SETPOINT,
    ROTOR_COMMAND,
    TF,
    TOPICS,
    TRUE_CONTACT,
    TRUE_ODOMETRY,
    TRUE_ROTORS,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import rotated_back_rows
from tombo_dynamics.time_base import EPOCH_NS, TICK_HZ

Log = Mapping[str, Array]
"""Columns (N, k) of `tombo_sim.kernel` by name."""


Ticks = slice | NDArray[np.intp]
"""Ticks of the log that have a message."""


def _every(rate_hz: int) -> slice:
    return slice(0, None, TICK_HZ // rate_hz)


def _runs(log: Log, rate_hz: int) -> NDArray[np.intp]:
    """Return the ticks in which a loop of the controller ran: the first of each slot."""
    phases = log["mode"].ravel()
    flying = np.flatnonzero((phases != Phase.IDLE) & (phases != Phase.LANDED))
    slot = flying // (TICK_HZ // rate_hz)
    return np.asarray(flying[np.diff(slot, prepend=-1) != 0])


def _transform(log: Log) -> tuple[Ticks, dict[str, Any]]:
    """Return the estimated pose, which is not there yet in the first ticks."""
    position = log["est_position"]
    known = np.flatnonzero(np.isfinite(position[:, 0]))
    ticks = known[known % (TICK_HZ // 50) == 0]
    return ticks, {
        "transforms[1].transform.translation": position[ticks],
        "transforms[1].transform.rotation": log["est_attitude"][ticks],
    }


def _battery(log: Log) -> tuple[Ticks, dict[str, Any]]:
    every = _every(10)
    _, current, voltage = log["battery"][every].T
    return every, {"current": -current, "voltage": voltage}  # negative while discharging


def _true_odometry(log: Log) -> tuple[Ticks, dict[str, Any]]:
    every = _every(250)
    values = {name: log[name][every] for name in ("position", "attitude", "rates")}
    velocity = rotated_back_rows(values["attitude"], log["velocity"][every])
    return every, {**values, "velocity": velocity}


def _true_contact(log: Log) -> tuple[Ticks, dict[str, Any]]:
    """Return the ticks with contact, and the first one after."""
    contact = log["contact"]
    touching = contact[:, 0] > 0.5
    released = np.zeros_like(touching)
    released[1:] = touching[:-1] & ~touching[1:]
    ticks = np.flatnonzero(touching | released)
    return ticks, {
        "in_contact": touching[ticks],
        "force": log["contact_force"][ticks],
        "rotor": contact[ticks, 1],
        "point": contact[ticks, 2:5],
    }


_FROM_LOG: Mapping[str, Callable[[Log], tuple[Ticks, dict[str, Any]]]] = {
    RATES_SETPOINT.name: lambda log: _taken(
        log, _runs(log, 250), rates="rates_setpoint", thrust="thrust_setpoint"
    ),
    ATTITUDE_SETPOINT.name: lambda log: _taken(
        log, _runs(log, 50), orientation="attitude_setpoint", thrust="thrust_setpoint"
    ),
    TF.name: _transform,
    BATTERY.name: _battery,
    TRUE_ODOMETRY.name: _true_odometry,
    TRUE_ROTORS.name: lambda log: _taken(
        log, _every(250), speed="rotor_speed", thrust="rotor_thrust", fold="fold", damage="damage"
    ),
    TRUE_CONTACT.name: _true_contact,
}
"""Topic → ticks and fields of its messages, of the log."""


def _taken(log: Log, ticks: Ticks, **columns: str) -> tuple[Ticks, dict[str, Any]]:
    """Return these ticks, and fields that are columns of the log: (N, k), of one number (N,)."""
    rows = {name: log[column][ticks] for name, column in columns.items()}
    return ticks, {k: v.ravel() if v.shape[1] == 1 else v for k, v in rows.items()}


def flown_topics(
    t: Array, log: Log, poses: Topic, published: Mapping[str, Topic] | None = None
) -> dict[str, Topic]:
    """Return the topics of a simulated flight: measurements and messages, then other columns.

    Args:
        t: (N,) ticks [s].
        log: its columns.
        poses: of the motion capture.
        published: messages of the cores.
    """
    topics = {
        MOCAP_POSE.name: poses,
        IMU.name: Topic.of(t, {"gyro": log["gyro"], "accel": log["accel"]}),
        ROTOR_COMMAND.name: Topic.of(t, {"speed": log["rotor_command"]}),
        **(published or {}),
    }
    for name, messages_of in _FROM_LOG.items():
        ticks, columns = messages_of(log)
        topics[name] = Topic.of(t[ticks], columns)
    return topics


def write_flight(sink: McapSink, flight: Flight) -> None:
    """Write a whole headless flight, or as much of one as there is: no tick at all is fine too.

    Raises:
        InputError: columns of different length.
    """
    sink.add_metadata(
        FLIGHT_METADATA,
        {
            "epoch_ns": str(EPOCH_NS),
            "scenario": json.dumps(flight.scenario, sort_keys=True, default=_plain),
            "events": json.dumps(flight.events, sort_keys=True, default=_plain),
        },
    )
    parts = [(name, *_messages(name, topic)) for name, topic in flight.topics.items()]
    parts.append((MARKERS.name, *_markers(flight)))
    written = []
    for name, times_ns, messages in parts:
        spec = TOPICS[name]
        channel = sink.add_channel(name, spec.typename, spec.qos)
        written.append(Columns(channel, times_ns, messages))
    sink.write_columns(*written)


def _messages(name: str, topic: Topic) -> tuple[NDArray[np.int64], Any]:
    """Return times and messages of a topic as in a file."""
    typename, times_ns = TOPICS[name].typename, nanoseconds(topic.arrival)
    columns = {field: series.values for field, series in topic.items()}
    stamps_ns = columns.pop("stamp_ns", None)
    if stamps_ns is None:
        stamps_ns = times_ns if topic.arrival is topic.t else nanoseconds(topic.t)
    if typename in FORMS:
        return times_ns, encoded(typename, {"stamp_ns": stamps_ns, **columns})
    records = layout(typename, CONSTANTS[typename]).records(len(times_ns))
    for header in ("transforms[0].", "transforms[1].") if typename == TF.typename else ("",):
        lay_in_times(records, f"{header}header.stamp", stamps_ns)
    for path, column in columns.items():
        lay_in(records, path, column)
    return times_ns, records


def _markers(flight: Flight) -> tuple[NDArray[np.int64], list[bytes]]:
    """Return times and messages: the obstacle, x_c of each detection, x_r after it."""
    obstacle = flight.scenario["obstacle"]
    cylinder = [obstacle[name] for name in ("x_m", "y_m", "radius_m", "top_m")]
    times, messages = [EPOCH_NS], [obstacle_marker(EPOCH_NS, cylinder)]
    kinds = {"detection": ("x_c", RED), "setpoint_switch": ("x_r", GREEN)}
    for event in flight.events:
        name, colour = kinds.get(event["kind"], ("", RED))
        point = event.get(f"{name}_m", np.nan)
        if name and np.isfinite(point).all():
            times.append(int(nanoseconds(event["time_s"])))
            messages.append(point_marker(times[-1], name, point, colour))
    return np.array(times, np.int64), messages


def _plain(value: Any) -> Any:
    """Turn what JSON does not know (arrays, numpy numbers, paths) into what it does."""
    return value.tolist() if hasattr(value, "tolist") else str(value)

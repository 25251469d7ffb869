"""A headless flight as ROS 2 topics: what the nodes publish in a live flight, written at once.

What was measured and published is written as it was; the rest follows from the log. Every stamp
and log time is the flight's own time plus `EPOCH_NS`, never the time of day: the same flight gives
the same bytes. The header's stamp is the time at which a value was true (for a pose of the motion
capture: its capture); the log time is the time at which it was known (its arrival).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import encode, lay_in, lay_in_times, layout
from tombo_bag.flight import Flight, Topic
from tombo_bag.flight_time import FLIGHT_METADATA, nanoseconds, stamp
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.message_codec import encoded
from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    BATTERY,
    MARKERS,
    RATES_SETPOINT,
    TF,
    TOPICS,
    TRUE_CONTACT,
    TRUE_ODOMETRY,
    TRUE_ROTORS,
    TopicSpec,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_BODY, FRAME_MAP
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import rotated_back_rows
from tombo_dynamics.time_base import EPOCH_NS, TICK_HZ

_BODY = {"header": {"frame_id": FRAME_BODY}}
_BODY_IN_MAP = {"header": {"frame_id": FRAME_MAP}, "child_frame_id": FRAME_BODY}
_NAN = float("nan")
_SPHERE, _CYLINDER = 2, 3
_POINT_DIAMETER_M = 0.12
"""How large x_c and x_r are drawn."""


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
    writer = _FlightWriter(sink, flight)
    for name, topic in flight.topics.items():
        writer.messages(TOPICS[name], topic)
    writer.setpoints()
    writer.transform()
    writer.battery()
    writer.truth()
    writer.contact()
    writer.markers()
    sink.write_columns(*writer.parts)


class _FlightWriter:
    """Turns the log's columns into messages, topic by topic."""

    def __init__(self, sink: McapSink, flight: Flight) -> None:
        self.sink = sink
        self.flight = flight
        self.log = flight.log
        self.parts: list[Columns] = []

    def add(self, spec: TopicSpec, times_ns: NDArray[np.int64], messages: Any) -> None:
        channel = self.sink.add_channel(spec.name, spec.typename, spec.qos)
        self.parts.append(Columns(channel, times_ns, messages))

    def messages(self, spec: TopicSpec, topic: Topic) -> None:
        """Write messages of the suite's own types by their fields."""
        columns = {name: one.values for name, one in topic.items()}
        columns = {"stamp_ns": nanoseconds(topic.t), **columns}
        self.add(spec, nanoseconds(topic.arrival), encoded(spec.typename, columns))

    def ticks(self, spec: TopicSpec, ticks: Any, columns: Mapping[str, Array]) -> None:
        """Write messages of some ticks."""
        self.messages(spec, Topic.of(self.flight.t[ticks], columns))

    def template(
        self,
        spec: TopicSpec,
        template: Mapping[str, Any],
        ticks: Any,
        values: Mapping[str, Array],
        stamp: str = "header.stamp",
    ) -> None:
        """Write messages that look like the template, with numbers laid in by path."""
        times_ns = nanoseconds(self.flight.t[ticks])
        records = layout(spec.typename, template).records(len(times_ns))
        lay_in_times(records, stamp, times_ns)
        for path, column in values.items():
            lay_in(records, path, column)
        self.add(spec, times_ns, records)

    def every(self, rate_hz: int) -> slice:
        return slice(0, None, TICK_HZ // rate_hz)

    def runs(self, rate_hz: int) -> NDArray[np.intp]:
        """Return the ticks in which a loop of the controller ran: the first of each slot."""
        phases = self.log["mode"].ravel()
        flying = np.flatnonzero((phases != Phase.IDLE) & (phases != Phase.LANDED))
        slot = flying // (TICK_HZ // rate_hz)
        return np.asarray(flying[np.diff(slot, prepend=-1) != 0])

    def setpoints(self) -> None:
        thrust = self.log["thrust_setpoint"].ravel()
        for spec, field, column, rate_hz in (
            (RATES_SETPOINT, "rates", "rates_setpoint", 250),
            (ATTITUDE_SETPOINT, "orientation", "attitude_setpoint", 50),
        ):
            ticks = self.runs(rate_hz)
            self.ticks(spec, ticks, {field: self.log[column][ticks], "thrust": thrust[ticks]})

    def transform(self) -> None:
        """Write the estimated pose, which is not there yet in the first ticks."""
        position = self.log["est_position"]
        known = np.flatnonzero(np.isfinite(position[:, 0]))
        ticks = known[known % (TICK_HZ // 50) == 0]
        values = {
            "transforms[0].transform.translation": position[ticks],
            "transforms[0].transform.rotation": self.log["est_attitude"][ticks],
        }
        stamp = "transforms[0].header.stamp"
        self.template(TF, {"transforms": [_BODY_IN_MAP]}, ticks, values, stamp)

    def battery(self) -> None:
        every = self.every(10)
        unknown = ("temperature", "charge", "capacity", "design_capacity", "percentage")
        template = {
            **_BODY,
            "present": True,
            "power_supply_status": 2,  # discharging
            "power_supply_technology": 3,  # lithium polymer
            **dict.fromkeys(unknown, _NAN),
        }
        _, current, voltage = self.log["battery"][every].T
        values = {"current": -current, "voltage": voltage}  # negative while discharging
        self.template(BATTERY, template, every, values)

    def truth(self) -> None:
        every = self.every(250)
        log = {name: column[every] for name, column in self.log.items()}
        odometry = {name: log[name] for name in ("position", "attitude", "rates")}
        velocity = rotated_back_rows(log["attitude"], log["velocity"])
        self.ticks(TRUE_ODOMETRY, every, {**odometry, "velocity": velocity})
        rotors = {"speed": log["rotor_speed"], "thrust": log["rotor_thrust"]}
        rotors |= {name: log[name] for name in ("fold", "damage")}
        self.ticks(TRUE_ROTORS, every, rotors)

    def contact(self) -> None:
        """Write the ticks with contact, and the first one after."""
        contact = self.log["contact"]
        touching = contact[:, 0] > 0.5
        released = np.zeros_like(touching)
        released[1:] = touching[:-1] & ~touching[1:]
        ticks = np.flatnonzero(touching | released)
        values = {
            "in_contact": touching[ticks],
            "force": self.log["contact_force"][ticks],
            "rotor": contact[ticks, 1],
            "point": contact[ticks, 2:5],
        }
        self.ticks(TRUE_CONTACT, ticks, values)

    def markers(self) -> None:
        """Write the obstacle, x_c of each detection and x_r of each set point after it."""
        obstacle = self.flight.scenario["obstacle"]
        height, diameter = obstacle["top_m"], 2.0 * obstacle["radius_m"]
        place = (obstacle["x_m"], obstacle["y_m"], 0.5 * height)
        size, grey = (diameter, diameter, height), (0.6, 0.6, 0.65, 0.8)
        times = [EPOCH_NS]
        markers = [_marker(EPOCH_NS, "obstacle", _CYLINDER, place, size, grey)]
        kinds = {
            "detection": ("x_c", (0.9, 0.2, 0.15, 1.0)),
            "setpoint_switch": ("x_r", (0.1, 0.6, 0.3, 1.0)),
        }
        for event in self.flight.events:
            if event["kind"] not in kinds:
                continue
            name, colour = kinds[event["kind"]]
            point = event[f"{name}_m"]
            if np.isfinite(point).all():
                times.append(int(nanoseconds(event["time_s"])))
                size = (_POINT_DIAMETER_M,) * 3
                markers.append(_marker(times[-1], name, _SPHERE, point, size, colour))
        messages = [encode(MARKERS.typename, {"markers": [marker]}) for marker in markers]
        self.add(MARKERS, np.array(times), messages)


def _marker(
    time_ns: int,
    name: str,
    shape: int,
    position: Sequence[float],
    scale: Sequence[float],
    colour: Sequence[float],
) -> dict[str, Any]:
    return {
        "header": {"stamp": stamp(time_ns), "frame_id": FRAME_MAP},
        "ns": name,
        "type": shape,
        "pose": {"position": dict(zip("xyz", position, strict=True)), "orientation": {"w": 1.0}},
        "scale": dict(zip("xyz", scale, strict=True)),
        "color": dict(zip("rgba", colour, strict=True)),
        "frame_locked": True,
        "text": name,
    }


def _plain(value: Any) -> Any:
    """Turn what JSON does not know (arrays, numpy numbers, paths) into what it does."""
    return value.tolist() if hasattr(value, "tolist") else str(value)

"""A flight record as ROS 2 topics: what the nodes publish in a live flight, written at once.

Every stamp and log time is the flight's own time plus `EPOCH_NS`, never the time of day: the same
flight gives the same bytes. The header's stamp is the time at which a value was true (for a pose
of the motion capture: its capture); the log time is the time at which it was known (its arrival).

| topic | type | rate |
|---|---|---|
| /mocap/pose | geometry_msgs/PoseStamped | as it arrived |
| /imu/data_raw | sensor_msgs/Imu | 1 kHz |
| /rotor_command | tombo_msgs/RotorSpeeds | 1 kHz |
| /odometry | nav_msgs/Odometry (estimate) | 250 Hz |
| /rates_setpoint | tombo_msgs/RatesSetpoint | 250 Hz |
| /mission/setpoint, /setpoint | tombo_msgs/PositionSetpoint | 50 Hz |
| /attitude_setpoint | tombo_msgs/AttitudeSetpoint | 50 Hz |
| /tf | tf2_msgs/TFMessage, map to base_link (estimate) | 50 Hz |
| /battery | sensor_msgs/BatteryState | 10 Hz |
| /collision_event, /reaction/status, /mission/status | tombo_msgs | when something happens |
| /markers | visualization_msgs/MarkerArray: obstacle, x_c, x_r | when something happens |
| /ground_truth/odometry | nav_msgs/Odometry | 250 Hz |
| /ground_truth/rotors | tombo_msgs/RotorState | 250 Hz |
| /ground_truth/contact | tombo_msgs/Contact | 1 kHz while touching, and at the release |
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columnar_cdr import layout
from tombo_bag.flight_events import EventMessages, event_messages
from tombo_bag.flight_time import FLIGHT_METADATA, nanoseconds, split_stamps
from tombo_bag.mcap_sink import Columns, McapSink
from tombo_bag.message_codec import MessageCodec, records_of
from tombo_bag.qos import EVENT, SENSOR, STATE, Qos
from tombo_bag.topics import TOPICS
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import map_to_body
from tombo_dynamics.time_base import EPOCH_NS, TICK_HZ, TICK_NS

FRAME_MAP = "map"
FRAME_BODY = "base_link"
UNKNOWN = -1.0
"""First element of a covariance in sensor_msgs: the quantity is not measured at all."""

Published = tuple[NDArray[np.int64], Any]
"""Ticks, and messages: structured (see `message_codec.records_of`), or a list of dataclasses."""


class Flight(Protocol):
    """What is needed of a flight record. Missing columns of the log leave out their topics."""

    @property
    def t(self) -> Array:
        """(N,) s, ticks of 1 kHz from 0."""
        ...

    @property
    def log(self) -> Mapping[str, Array]:
        """Columns (N, k) by name."""
        ...

    @property
    def mocap_t(self) -> Array:
        """(M,) s, capture times of the motion capture's poses."""
        ...

    @property
    def mocap_arrival(self) -> Array:
        """(M,) s, when they arrived."""
        ...

    @property
    def mocap_position(self) -> Array:
        """(M, 3) m, map."""
        ...

    @property
    def mocap_attitude(self) -> Array:
        """(M, 4) quaternion xyzw, map from base_link."""
        ...

    @property
    def events(self) -> Sequence[Mapping[str, Any]]:
        """What happened: each with time_s, kind and more."""
        ...

    @property
    def published(self) -> Mapping[str, Published]:
        """What the cores published, by topic; what is missing follows from the log."""
        ...

    @property
    def scenario(self) -> Mapping[str, Any]:
        """The scenario as flown, with obstacle {x_m, y_m, radius_m, top_m}."""
        ...


def write_flight(sink: McapSink, record: Flight) -> None:
    """Write a whole flight, or as much of one as there is: no tick at all is fine too.

    Raises:
        InputError: columns of different length.
    """
    sink.add_metadata(
        FLIGHT_METADATA,
        {
            "epoch_ns": str(EPOCH_NS),
            "scenario": json.dumps(record.scenario, sort_keys=True, default=_plain),
            "events": json.dumps(list(record.events), sort_keys=True, default=_plain),
        },
    )
    writer = _FlightWriter(sink, record)
    writer.mocap()
    writer.imu()
    writer.rotor_command()
    for topic, (ticks, said) in record.published.items():
        writer.published(topic, ticks, said)
    if not record.published:
        writer.odometry("/odometry", "est_position", "est_attitude", "est_velocity", "gyro", STATE)
        writer.setpoint("/mission/setpoint", ("mission_setpoint", "position_setpoint"))
        writer.setpoint("/setpoint", ("position_setpoint",))
    writer.rates_setpoint()
    writer.attitude_setpoint()
    writer.transform()
    writer.battery()
    writer.odometry("/ground_truth/odometry", "position", "attitude", "velocity", "rates", SENSOR)
    writer.rotors()
    writer.contact()
    for messages in event_messages(record.events, record.scenario, record.t, writer.phases()):
        if messages.topic not in record.published:
            writer.events(messages)
    sink.write_columns(*writer.parts)


class _FlightWriter:
    """Turns the log's columns into messages, topic by topic."""

    def __init__(self, sink: McapSink, record: Flight) -> None:
        self.sink = sink
        self.record = record
        self.times_ns = nanoseconds(record.t)
        self.parts: list[Columns] = []

    def column(self, name: str, width: int) -> Array | None:
        values = self.record.log.get(name)
        if values is None:
            return None
        return np.asarray(values, np.float64).reshape(-1, width)

    def phases(self) -> NDArray[np.int64] | None:
        values = self.column("mode", 1)
        return None if values is None else values[:, 0].astype(np.int64)

    def topic(
        self,
        name: str,
        typename: str,
        template: Mapping[str, Any],
        times_ns: NDArray[np.int64],
        qos: Qos = STATE,
        stamp: str = "header.stamp",
        stamps_ns: NDArray[np.int64] | None = None,
    ) -> NDArray[np.void]:
        """Announce a topic and return its messages, stamped; the caller lays in the rest."""
        records = layout(typename, template).records(len(times_ns))
        seconds, rest = split_stamps(times_ns if stamps_ns is None else stamps_ns)
        records[f"{stamp}.sec"] = seconds
        records[f"{stamp}.nanosec"] = rest
        self.parts.append(Columns(self.sink.add_channel(name, typename, qos), times_ns, records))
        return records

    def every(self, rate_hz: int) -> slice:
        return slice(0, None, TICK_HZ // rate_hz)

    def runs(self, rate_hz: int) -> Any:
        """Return the ticks in which a loop of the controller ran: the first of each slot."""
        phases = self.phases()
        if phases is None or not self.record.published:
            return self.every(rate_hz)
        flying = np.flatnonzero((phases != Phase.IDLE) & (phases != Phase.LANDED))
        return flying[np.diff(flying // (TICK_HZ // rate_hz), prepend=-1) != 0]

    def published(self, topic: str, ticks: NDArray[np.int64], messages: Any) -> None:
        """Write what was published as it was."""
        spec = TOPICS[topic]
        if isinstance(messages, np.ndarray):
            written: Any = records_of(spec.typename, messages)
        else:
            codec = MessageCodec(spec.typename)
            written = [codec.encode(message) for message in messages]
        times_ns = EPOCH_NS + ticks * TICK_NS
        channel = self.sink.add_channel(topic, spec.typename, spec.qos)
        self.parts.append(Columns(channel, times_ns, written))

    def mocap(self) -> None:
        arrival = np.asarray(self.record.mocap_arrival, np.float64)
        seen = np.isfinite(arrival)
        captured = nanoseconds(np.asarray(self.record.mocap_t, np.float64)[seen])
        records = self.topic(
            "/mocap/pose",
            "geometry_msgs/msg/PoseStamped",
            {"header": {"frame_id": FRAME_MAP}},
            nanoseconds(arrival[seen]),
            SENSOR,
            stamps_ns=captured,
        )
        position = np.asarray(self.record.mocap_position, np.float64).reshape(-1, 3)
        attitude = np.asarray(self.record.mocap_attitude, np.float64).reshape(-1, 4)
        _vector(records, "pose.position", position[seen])
        _vector(records, "pose.orientation", attitude[seen])

    def imu(self) -> None:
        gyro, accel = self.column("gyro", 3), self.column("accel", 3)
        if gyro is None or accel is None:
            return
        no_orientation = [UNKNOWN] + 8 * [0.0]
        records = self.topic(
            "/imu/data_raw",
            "sensor_msgs/msg/Imu",
            {"header": {"frame_id": FRAME_BODY}, "orientation_covariance": no_orientation},
            self.times_ns,
            SENSOR,
        )
        records["orientation.w"] = 1.0
        _vector(records, "angular_velocity", gyro)
        _vector(records, "linear_acceleration", accel)

    def rotor_command(self) -> None:
        command = self.column("rotor_command", 4)
        if command is None:
            return
        records = self.topic(
            "/rotor_command",
            "tombo_msgs/msg/RotorSpeeds",
            {"header": {"frame_id": FRAME_BODY}},
            self.times_ns,
            SENSOR,
        )
        records["speed"] = command

    def odometry(
        self, topic: str, position: str, attitude: str, velocity: str, rates: str, qos: Qos
    ) -> None:
        """Write poses in map with twists in base_link, as nav_msgs/Odometry wants them."""
        where, how = self.column(position, 3), self.column(attitude, 4)
        moving, turning = self.column(velocity, 3), self.column(rates, 3)
        if where is None or how is None:
            return
        every = self.every(250)
        records = self.topic(
            topic,
            "nav_msgs/msg/Odometry",
            {"header": {"frame_id": FRAME_MAP}, "child_frame_id": FRAME_BODY},
            self.times_ns[every],
            qos,
        )
        _vector(records, "pose.pose.position", where[every])
        _vector(records, "pose.pose.orientation", how[every])
        if moving is not None:
            _vector(records, "twist.twist.linear", map_to_body(how[every], moving[every]))
        if turning is not None:
            _vector(records, "twist.twist.angular", turning[every])

    def rates_setpoint(self) -> None:
        rates = self.column("rates_setpoint", 3)
        thrust = self.column("thrust_setpoint", 1)
        if rates is None:
            return
        every = self.runs(250)
        records = self.topic(
            "/rates_setpoint",
            "tombo_msgs/msg/RatesSetpoint",
            {"header": {"frame_id": FRAME_BODY}},
            self.times_ns[every],
        )
        _vector(records, "rates", rates[every])
        if thrust is not None:
            records["thrust"] = thrust[every, 0]

    def setpoint(self, topic: str, names: tuple[str, ...]) -> None:
        """Write wanted positions, with velocity and acceleration to be fed forward."""
        found = [c for c in (self.column(name, 3) for name in names) if c is not None]
        if not found:
            return
        every = self.every(50)
        records = self.topic(
            topic,
            "tombo_msgs/msg/PositionSetpoint",
            {"header": {"frame_id": FRAME_MAP}},
            self.times_ns[every],
        )
        _vector(records, "position", found[0][every])
        for field in ("velocity", "acceleration"):
            fed = self.column(f"{field}_setpoint", 3)
            if fed is not None:
                _vector(records, field, fed[every])
        attitude, phases = self.column("attitude_setpoint", 4), self.phases()
        if attitude is not None:
            records["yaw"] = heading(attitude[every])
        if phases is not None:
            records["phase"] = phases[every]

    def attitude_setpoint(self) -> None:
        attitude = self.column("attitude_setpoint", 4)
        thrust = self.column("thrust_setpoint", 1)
        if attitude is None:
            return
        every = self.runs(50)
        records = self.topic(
            "/attitude_setpoint",
            "tombo_msgs/msg/AttitudeSetpoint",
            {"header": {"frame_id": FRAME_MAP}},
            self.times_ns[every],
        )
        _vector(records, "orientation", attitude[every])
        if thrust is not None:
            records["thrust"] = thrust[every, 0]

    def transform(self) -> None:
        position, attitude = self.column("est_position", 3), self.column("est_attitude", 4)
        if position is None or attitude is None:
            return
        known = np.isfinite(position[:, 0])  # there is no estimate yet in the first ticks
        every = np.flatnonzero(known & (np.arange(len(known)) % (TICK_HZ // 50) == 0))
        one = {"header": {"frame_id": FRAME_MAP}, "child_frame_id": FRAME_BODY}
        records = self.topic(
            "/tf",
            "tf2_msgs/msg/TFMessage",
            {"transforms": [one]},
            self.times_ns[every],
            stamp="transforms[0].header.stamp",
        )
        _vector(records, "transforms[0].transform.translation", position[every])
        _vector(records, "transforms[0].transform.rotation", attitude[every])

    def battery(self) -> None:
        battery = self.column("battery", 3)
        if battery is None:
            return
        every = self.every(10)
        nan = float("nan")
        unknown = ("temperature", "charge", "capacity", "design_capacity", "percentage")
        records = self.topic(
            "/battery",
            "sensor_msgs/msg/BatteryState",
            {
                "header": {"frame_id": FRAME_BODY},
                "present": True,
                "power_supply_status": 2,  # discharging
                "power_supply_technology": 3,  # lithium polymer
                **dict.fromkeys(unknown, nan),
            },
            self.times_ns[every],
            SENSOR,
        )
        _, current, voltage = battery[every].T
        records["current"] = -current  # sensor_msgs: negative while discharging
        records["voltage"] = voltage

    def rotors(self) -> None:
        names = {"speed": "rotor_speed", "thrust": "rotor_thrust", "fold": "fold"}
        columns = {
            field: self.column(name, 4) for field, name in {**names, "damage": "damage"}.items()
        }
        if columns["speed"] is None:
            return
        every = self.every(250)
        records = self.topic(
            "/ground_truth/rotors",
            "tombo_msgs/msg/RotorState",
            {"header": {"frame_id": FRAME_BODY}},
            self.times_ns[every],
            SENSOR,
        )
        for field, column in columns.items():
            if column is not None:
                records[field] = column[every]

    def contact(self) -> None:
        """Write the ticks with contact, and the first one after."""
        force, contact = self.column("contact_force", 3), self.column("contact", 5)
        if force is None:
            return
        touching = (force != 0.0).any(axis=1) if contact is None else contact[:, 0] > 0.5
        released = np.zeros_like(touching)
        released[1:] = touching[:-1] & ~touching[1:]
        ticks = np.flatnonzero(touching | released)
        nan = float("nan")
        records = self.topic(
            "/ground_truth/contact",
            "tombo_msgs/msg/Contact",
            {
                "header": {"frame_id": FRAME_MAP},
                "rotor": -1,
                "point": {"x": nan, "y": nan, "z": nan},
            },
            self.times_ns[ticks],
            SENSOR,
        )
        records["in_contact"] = touching[ticks]
        _vector(records, "force", force[ticks])
        if contact is not None:
            records["rotor"] = contact[ticks, 1]
            _vector(records, "point", contact[ticks, 2:5])

    def events(self, messages: EventMessages) -> None:
        channel = self.sink.add_channel(messages.topic, messages.typename, EVENT)
        self.parts.append(Columns(channel, messages.times_ns, messages.messages))


def heading(attitude: Array) -> Array:
    """Return the yaw [rad], counter-clockwise from map x, of (N, 4) quaternions xyzw."""
    x, y, z, w = attitude.T
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _vector(records: NDArray[np.void], path: str, values: Array) -> None:
    """Lay (N, 3) or (N, 4) values into the fields x, y, z, w below a path."""
    for i, axis in enumerate("xyzw"[: values.shape[1]]):
        records[f"{path}.{axis}"] = values[:, i]


def _plain(value: Any) -> Any:
    """Turn what JSON does not know (arrays, numpy numbers, paths) into what it does."""
    return value.tolist() if hasattr(value, "tolist") else str(value)

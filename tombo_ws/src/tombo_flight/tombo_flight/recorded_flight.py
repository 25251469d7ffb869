"""A recorded flight, with the figures of a simulated one.

For recordings of the simulated vehicle, by the headless flight or by the nodes, the ground truth
at whatever rate is what is known. Of a real vehicle there is none: the motion capture's poses are
what is known then, contact is what the detector says, and the summary says so (`known_from`). All
signals are resampled to the simulator's ticks of 1 ms.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable, TopicColumns
from tombo_bag.flight import Flight, Topic
from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.message_codec import fields_of
from tombo_bag.recording import Recording
from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    BATTERY,
    COLLISION_EVENT,
    CONTACT_EVENT,
    DETECTOR_STATUS,
    IMU,
    MARKERS,
    MISSION_STATUS,
    MOCAP_POSE,
    ODOMETRY,
    PX4_STATUS,
    RATES_SETPOINT,
    REACTION_STATUS,
    ROTOR_COMMAND,
    SETPOINT,
    TRUE_CONTACT,
    TRUE_ODOMETRY,
    TRUE_ROTORS,
)
from tombo_dynamics.arrays import Array, Times
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase, Trigger
from tombo_dynamics.rotation import conjugate, map_to_body, unwrap_quaternions
from tombo_dynamics.time_base import SECOND_NS, TICK_HZ, TICK_NS, TICK_S
from tombo_flight.flight_metrics import phase_event, with_figures
from tombo_flight.scenario import Scenario, as_mapping, scenario_from_mapping
from tombo_px4.modes import landing_phases
from tombo_sim.kernel import LogRow

_FIRST_POSES = 3
"""Number of poses of the motion capture from which the estimator begins."""
_FIRST_STEP_NS = 20 * TICK_NS
"""Longest time from the first estimate to the mission's first message: its period."""
_LONGEST_TICKS = 4 * 3600 * TICK_HZ
"""Largest number of ticks of a flight; a stamp of another clock makes it longer."""
_UNIT = 1e-2
"""How far from 1 the length of a rotation's quaternion may be."""
_MEASURED_VELOCITY = "velocity_in_map"
_BEYOND_NS = SECOND_NS
"""A flight ends at most this time after its last known state."""
_TOPICS = (
    *(ATTITUDE_SETPOINT, BATTERY, COLLISION_EVENT, CONTACT_EVENT, DETECTOR_STATUS, IMU, MARKERS),
    *(MISSION_STATUS, MOCAP_POSE, ODOMETRY, PX4_STATUS, RATES_SETPOINT, REACTION_STATUS),
    *(ROTOR_COMMAND, SETPOINT, TRUE_CONTACT, TRUE_ODOMETRY, TRUE_ROTORS),
)
_INTERPOLATED = {
    "position": (TRUE_ODOMETRY.name, "position"),
    "rates": (TRUE_ODOMETRY.name, "rates"),
    "est_position": (ODOMETRY.name, "position"),
    "rotor_speed": (TRUE_ROTORS.name, "speed"),
    "rotor_thrust": (TRUE_ROTORS.name, "thrust"),
    "fold": (TRUE_ROTORS.name, "fold"),
    "damage": (TRUE_ROTORS.name, "damage"),
}
"""Column of the log → topic and field of a quantity that is interpolated between messages."""
_STEPWISE = {
    "gyro": (IMU.name, "gyro"),
    "accel": (IMU.name, "accel"),
    "position_setpoint": (SETPOINT.name, "position"),
    "velocity_setpoint": (SETPOINT.name, "velocity"),
    "acceleration_setpoint": (SETPOINT.name, "acceleration"),
    "attitude_setpoint": (ATTITUDE_SETPOINT.name, "orientation"),
    "thrust_setpoint": (ATTITUDE_SETPOINT.name, "thrust"),
    "rates_setpoint": (RATES_SETPOINT.name, "rates"),
    "rotor_command": (ROTOR_COMMAND.name, "speed"),
}
"""Column of the log → topic and field of a quantity that holds until the next message."""
_TRANSPORT_NS = {SETPOINT.name: TICK_NS}
"""The log has what the controller follows: a set point of tick k reaches it at k + 1."""

Fields = Mapping[str, TopicColumns]
"""Topic → its messages, see `message_codec.fields_of`."""


def read_flight(path: Path, wall_time_s: float = 0.0) -> Flight:
    """Read a recorded flight, with its summary.

    Time 0 is that of the file's metadata, else the first true pose; where nodes came later than
    the simulator, it is as long before the mission's first word as the estimator takes to begin.
    Values not published are NaN; values not yet published are the first published ones.

    Args:
        path: recording of a flight: a file, or a folder of them.
        wall_time_s: how long the flight took, for the summary.

    Raises:
        InputError: no recording, or one with neither ground truth nor poses of a motion capture.
    """
    with Recording(path) as recording:
        recording.load([spec.name for spec in _TOPICS])
        there = {name: s.typename for name, s in recording.topics.items() if s.count}
        fields = {
            spec.name: fields_of(there[spec.name], recording.columns(spec.name))
            for spec in _TOPICS
            if spec.name in there
        }
        metadata = recording.metadata.get(FLIGHT_METADATA, {})
    fields = {name: table for name, table in fields.items() if len(table["log_time_ns"])}
    try:
        flown, scenario = scenario_of_metadata(metadata)
    except InputError as error:
        raise InputError(f"'{path}': {error}") from error
    has_truth = TRUE_ODOMETRY.name in fields
    motion = fields[TRUE_ODOMETRY.name] if has_truth else _mocap_track(path, fields)
    known = motion["stamp_ns"]
    ticks = _ticks(path, fields, known, _epoch(metadata, fields, known, scenario))
    flight = Flight(
        _topics(fields, ticks.epoch_ns),
        name=scenario.name,
        source=f"{path} (recording)",
        t=np.arange(ticks.count, dtype=np.float64) * TICK_S,
        log=_log({**fields, TRUE_ODOMETRY.name: motion}, ticks),
        scenario=flown | _obstacle(fields),
        epoch_ns=ticks.epoch_ns,
    )
    if not has_truth:
        _assume_contact(flight)
    phase = flight.log["mode"][:, 0]
    changes = np.flatnonzero(phase[1:] != phase[:-1]) + 1
    phases = [phase_event(flight.t[k], phase[k]) for k in changes]
    flight = with_figures(flight, scenario, int(flown.get("seed", 0)), wall_time_s, phases)
    return flight if has_truth else _without_truth(flight)


@dataclass(frozen=True)
class _Ticks:
    """The ticks of a flight."""

    epoch_ns: int
    count: int

    def at(self, stamps_ns: Times) -> Times:
        """Return the tick nearest to each stamp, whether or not it is one of the flight's."""
        return (stamps_ns - self.epoch_ns + TICK_NS // 2) // TICK_NS

    def interpolate(self, stamps_ns: Times, values: Array) -> Array:
        """Return (count, k): straight lines between the values; beyond them, the nearest."""
        at, last = self._last_at(stamps_ns)
        every = np.arange(self.count)
        return np.column_stack([np.interp(every, at, column) for column in values[last].T])

    def hold(self, stamps_ns: Times, values: Array) -> Array:
        """Return (count, k): each value until the next one; the first also before it."""
        at, last = self._last_at(stamps_ns)
        row = np.searchsorted(at, np.arange(self.count), side="right") - 1
        return np.asarray(values[last][np.maximum(row, 0)], np.float64)

    def _last_at(self, stamps_ns: Times) -> tuple[Times, NDArray[np.intp]]:
        """Return the ticks that have a value, rising, and the row of the last one at each."""
        at = self.at(stamps_ns)
        found, first_of_reversed = np.unique(at[::-1], return_index=True)
        return found, at.size - 1 - first_of_reversed


def _ticks(path: Path, fields: Fields, known: Times, epoch_ns: int) -> _Ticks:
    """Return the ticks from the epoch to the last known state.

    Raises:
        InputError: these are too many.
    """
    last = int(known.max())
    if IMU.name in fields:
        last_imu = int(fields[IMU.name]["stamp_ns"].max())
        last = max(last, min(last_imu, last + _BEYOND_NS))
    count = (last - epoch_ns + TICK_NS // 2) // TICK_NS + 1
    if not 0 < count < _LONGEST_TICKS:
        raise InputError(
            f"'{path}' has {count * TICK_S:.0f} s from its first stamp to its last; accepted: "
            "the stamps of one flight"
        )
    return _Ticks(epoch_ns, count)


def _topics(fields: Fields, epoch_ns: int) -> dict[str, Topic]:
    """Return the topics, in flight time."""
    truth = fields.get(TRUE_ODOMETRY.name)
    times = ("log_time_ns", "publish_time_ns")
    return {
        name: Topic.of(
            _seconds(table.get("stamp_ns", table["log_time_ns"]), epoch_ns),
            {field: values for field, values in table.items() if field not in times},
            _arrival(table["log_time_ns"], truth, epoch_ns),
        )
        for name, table in fields.items()
    }


def _seconds(times_ns: Times, epoch_ns: int) -> Array:
    return np.asarray((times_ns - epoch_ns) * 1e-9)


def _arrival(log_times_ns: Times, truth: ColumnTable | None, epoch_ns: int) -> Array:
    """Return the flight time [s] of moments on the recorder's clock.

    In simulated time that clock is another one: the truth tells both, its stamp and when it was
    published. A real vehicle flies in real time.
    """
    if truth is None:
        return _seconds(log_times_ns, epoch_ns)
    there = np.maximum.accumulate(truth["publish_time_ns"])
    first = int(there[0])  # floats have no room for nanoseconds since 1970
    flight = _seconds(truth["stamp_ns"], epoch_ns)
    asked, rising = log_times_ns - first, there - first
    span = max(float(rising[-1]), 1.0)
    rate = (flight[-1] - flight[0]) / span
    beyond = np.minimum(asked, 0.0) + np.maximum(asked - rising[-1], 0.0)
    return np.asarray(np.interp(asked, rising, flight) + rate * beyond)


def _log(fields: Fields, ticks: _Ticks) -> dict[str, Array]:
    """Return the columns of the simulator's log; unknown values are NaN."""
    log = {
        name: np.full((ticks.count, *one.shape), math.nan) for name, one in LogRow.fields.items()
    }
    for sources, resample in ((_INTERPOLATED, ticks.interpolate), (_STEPWISE, ticks.hold)):
        for column, (topic, field) in sources.items():
            if (table := fields.get(topic)) is not None:
                stamps = table["stamp_ns"] + _TRANSPORT_NS.get(topic, 0)
                values = np.asarray(table[field], np.float64)
                log[column] = resample(stamps, values.reshape(len(stamps), -1))
    for topic, prefix in ((TRUE_ODOMETRY.name, ""), (ODOMETRY.name, "est_")):
        if (table := fields.get(topic)) is not None:
            stamps, turns = table["stamp_ns"], table["attitude"]
            log[f"{prefix}velocity"] = ticks.interpolate(stamps, _velocity_in_map(table))
            attitude = ticks.interpolate(stamps, unwrap_quaternions(turns))
            attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
            log[f"{prefix}attitude"] = attitude
    if _MEASURED_VELOCITY in fields[TRUE_ODOMETRY.name]:
        log["rates"] = log["gyro"].copy()
    if (table := fields.get(BATTERY.name)) is not None:
        both = np.column_stack([-table["current"], table["voltage"]])
        log["battery"][:, 1:] = ticks.hold(table["stamp_ns"], both)
    _fill_contact(log, fields, ticks)
    log["mode"] = _phases(fields, ticks)
    return log


def _velocity_in_map(table: TopicColumns) -> Array:
    if _MEASURED_VELOCITY in table:
        return table[_MEASURED_VELOCITY]
    return map_to_body(conjugate(table["attitude"]), table["velocity"])


def _fill_contact(log: dict[str, Array], fields: Fields, ticks: _Ticks) -> None:
    """Mark the ticks with contact."""
    log["contact"][:], log["contact_force"][:] = 0.0, 0.0
    table = fields.get(TRUE_CONTACT.name)
    if table is None:
        return
    at = ticks.at(table["stamp_ns"])
    there = table["in_contact"].astype(bool) & (at >= 0) & (at < ticks.count)
    at = at[there]
    log["contact"][at, 0] = 1.0
    log["contact"][at, 1] = table["rotor"][there]
    log["contact"][at, 2:5] = table["point"][there]
    log["contact_force"][at] = table["force"][there]


def _phases(fields: Fields, ticks: _Ticks) -> Array:
    """Return the phase of the set point followed, a tick after it was published.

    Where no set points were recorded, it is the mission's phase; that it has landed may come
    after the last of them. While PX4 lands by its own mode, the vehicle follows that.
    """
    phases: Array = np.full((ticks.count, 1), float(Phase.IDLE))
    for name in (SETPOINT.name, MISSION_STATUS.name):
        if (table := fields.get(name)) is not None:
            stamps = table["stamp_ns"] + _TRANSPORT_NS.get(name, 0)
            phases = ticks.hold(stamps, table["phase"][:, None])
            phases[: max(int(ticks.at(stamps).min()), 0)] = Phase.IDLE
            break
    setpoints, status = fields.get(SETPOINT.name), fields.get(MISSION_STATUS.name)
    if setpoints is not None and status is not None and status["phase"][-1] == Phase.LANDED:
        landed_ns = status["stamp_ns"][-1:]
        if landed_ns[0] > setpoints["stamp_ns"].max():
            phases[max(int(ticks.at(landed_ns)[0]), 0) :] = Phase.LANDED
    if (px4 := fields.get(PX4_STATUS.name)) is not None:
        landing = landing_phases(px4["armed"], px4["mode"])
        own = ticks.hold(px4["stamp_ns"], landing[:, None])
        phases = np.where(np.isfinite(own) & (phases != Phase.LANDED), own, phases)
    return phases


def _obstacle(fields: Fields) -> dict[str, Any]:
    """Return the obstacle of the markers as the scenario has it: its place depends on the seed."""
    table = fields.get(MARKERS.name)
    names = None if table is None else table.get("markers[0].ns")
    if table is None or names is None or not (names == "obstacle").any():
        return {}
    i = int(np.argmax(names == "obstacle"))
    x, y, _ = table["markers[0].pose.position"][i].tolist()
    width, _, top = table["markers[0].scale"][i].tolist()
    return {"obstacle": {"x_m": x, "y_m": y, "radius_m": 0.5 * width, "top_m": top}}


def _mocap_track(path: Path, fields: Fields) -> TopicColumns:
    """Return the track that the motion capture has measured.

    Raises:
        InputError: it has not.
    """
    table = fields.get(MOCAP_POSE.name)
    track = None if table is None else measured_track(table)
    if track is None:
        raise InputError(
            f"'{path}': nothing on {TRUE_ODOMETRY.name}, and no poses on {MOCAP_POSE.name}; "
            "accepted: a recording of a flight"
        )
    return track


def measured_track(poses: Mapping[str, NDArray[Any]]) -> TopicColumns | None:
    """Return the track of poses as recorded: in any order, some twice, some no numbers at all.

    Args:
        poses: stamp_ns (N,), position (N, 3) in map [m], attitude (N, 4) xyzw.

    Returns:
        The same, rising, with velocity_in_map [m/s] by central differences and rates that are not
        known; None if fewer than two poses can be used.
    """
    with np.errstate(invalid="ignore"):
        unit = np.abs(np.linalg.norm(poses["attitude"], axis=1) - 1.0) < _UNIT
    good = np.flatnonzero(unit & np.isfinite(poses["position"]).all(axis=1))
    stamps, first = np.unique(poses["stamp_ns"][good], return_index=True)
    rows = good[first]
    if rows.size < 2:
        return None
    track = {name: poses[name][rows] for name in ("stamp_ns", "position", "attitude")}
    seconds = (stamps - stamps[0]) * 1e-9
    track[_MEASURED_VELOCITY] = np.gradient(track["position"], seconds, axis=0)
    track["rates"] = np.full(track["position"].shape, math.nan)
    return TopicColumns(MOCAP_POSE.name, track)


def _assume_contact(flight: Flight) -> None:
    """Take the first contact from the detector."""
    if (topic := flight.topics.get(COLLISION_EVENT.name)) is None:
        return
    by_motion = topic["trigger"].values == Trigger.INNOVATION
    contacts = flight.seconds(topic["contact_stamp_ns"].values[by_motion])
    at = np.rint(contacts[np.argsort(topic.arrival[by_motion], kind="stable")] / TICK_S)
    there = at[(at >= 0) & (at < flight.t.size)].astype(np.int64)
    flight.log["contact"][there[:1], 0] = 1.0


def _without_truth(flight: Flight) -> Flight:
    """Remove figures that need the ground truth, and mark them as missing."""
    unknown = (
        *("contact_point_m", "contact_rotor", "detection_latency_s", "strikes"),
        *("peak_contact_force_n", "rotors_broken"),
    )
    words = {"contact": "contact, as the detector has it"}
    return replace(
        flight,
        summary={**flight.summary, **dict.fromkeys(unknown), "known_from": "mocap"},
        events=[{**e, "text": words.get(str(e["kind"]), e["text"])} for e in flight.events],
    )


def _epoch(metadata: Mapping[str, str], fields: Fields, stamps: Times, scenario: Scenario) -> int:
    """Return the stamp of the flight's tick 0, where what is known has these stamps.

    The mission's first word comes some poses and a step after the beginning at most.
    """
    known = metadata.get("epoch_ns", "")
    if known.isdecimal():
        return int(known)
    first = int(stamps.min())
    mission = fields.get(MISSION_STATUS.name)
    if mission is None:
        return first
    lead_ns = _FIRST_STEP_NS + round(SECOND_NS * _FIRST_POSES / scenario.estimator.mocap_rate)
    began = int(mission["stamp_ns"].min()) - lead_ns
    ticks = (min(max(began, first), int(stamps.max())) - first + TICK_NS - 1) // TICK_NS
    return first + ticks * TICK_NS


def scenario_of_metadata(metadata: Mapping[str, str]) -> tuple[dict[str, Any], Scenario]:
    """Return the scenario as flown, and as a scenario again; defaults if the file has none.

    Raises:
        InputError: the file's content is not a flight.
    """
    text = metadata.get("scenario")
    if text is None:
        nothing = Scenario(name="recording")
        return as_mapping(nothing), nothing
    try:
        flown = dict(json.loads(text))
        values = {key: value for key, value in flown.items() if key != "seed"}
        pole = values.get("obstacle", {})
        if "x_m" in pole:
            values["obstacle"] = {key: pole[f"{key}_m"] for key in ("x", "y", "radius", "top")}
        return flown, scenario_from_mapping(values, str(flown.get("name", "recording")))
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        why = error if isinstance(error, InputError) else "it is none"
        raise InputError(f"its scenario can't be used: {why}") from error

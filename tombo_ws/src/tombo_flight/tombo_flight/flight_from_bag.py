"""A recorded flight as a flight record, so that the same functions compute its figures.

For recordings of the simulated vehicle, by the headless flight or by the nodes, the ground truth
at whatever rate is what is known. Of a real vehicle there is none: the motion capture's poses are
what is known then, contact is what the detector says, and the summary says so (`known_from`). All
is laid on the simulator's ticks of 1 ms.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable
from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.formats.unpacking import memory_limit
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
from tombo_collision.decision import Decision
from tombo_collision.detector import CollisionEvent
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import ROTOR_UNKNOWN, Phase, ReactionPhase, Trigger
from tombo_dynamics.rotation import conjugate, map_to_body, unwrap_quaternions
from tombo_dynamics.time_base import SECOND_NS, TICK_NS, TICK_S
from tombo_flight.flight_metrics import MetricsInput, collision_events, phase_event, summarize
from tombo_flight.flight_record import FlightRecord
from tombo_flight.pose_track import PoseTrack, pose_track
from tombo_flight.replay.poses import vectors
from tombo_flight.scenario import Scenario, as_mapping, scenario_from_mapping
from tombo_px4.bridge.modes import AUTO_LAND, AUTO_RTL, mode_name
from tombo_sim.log_columns import LogRow

Ticks = NDArray[np.int64]

_FIRST_POSES = 3
"""The estimator begins from so many poses of the motion capture."""
_FIRST_STEP_NS = 20 * TICK_NS
"""Longest time from the first estimate to the mission's first message: its period."""
_TICK_BYTES = 2000
"""Memory that a tick takes, with all of its columns and what is made of them."""
_DIGITS = 20
_PX4_LANDS = (mode_name(AUTO_LAND), mode_name(AUTO_RTL))
"""Modes of PX4 that end on the ground."""
_BEYOND_NS = SECOND_NS
"""A flight ends at most this time after its last known state."""
_NAME_OF_TRIGGER = {int(trigger): trigger.name.lower() for trigger in Trigger}
_TOPICS = (
    *(
        ATTITUDE_SETPOINT,
        BATTERY,
        COLLISION_EVENT,
        CONTACT_EVENT,
        DETECTOR_STATUS,
        IMU,
        MARKERS,
        MISSION_STATUS,
    ),
    *(MOCAP_POSE, ODOMETRY, PX4_STATUS, RATES_SETPOINT, REACTION_STATUS, ROTOR_COMMAND, SETPOINT),
    *(TRUE_CONTACT, TRUE_ODOMETRY, TRUE_ROTORS),
)


def flight_from_bag(path: Path, wall_time_s: float = 0.0) -> FlightRecord:
    """Read a recording back into a flight record, with its summary.

    Time 0 is that of the file's metadata, else the first true pose; where nodes came later than
    the simulator, it is as long before the mission's first word as the estimator takes to begin.
    What was not published is NaN; what was not yet published is as it was first.

    Args:
        path: recording of a flight: a file, or a folder of them.
        wall_time_s: how long the flight took, for the summary.

    Raises:
        InputError: no recording, or one with neither ground truth nor poses of a motion capture.
    """
    with Recording(path) as recording:
        recording.load([spec.name for spec in _TOPICS])
        tables = {
            spec.name: recording.columns(spec.name)
            for spec in _TOPICS
            if spec.name in recording.topics and recording.topics[spec.name].count
        }
        metadata = recording.metadata.get(FLIGHT_METADATA, {})
    tables = {name: table for name, table in tables.items() if len(table["log_time_ns"])}
    return _RecordedFlight(path, tables, metadata).record(wall_time_s)


@dataclass(frozen=True)
class _Grid:
    """The ticks of a flight."""

    epoch_ns: int
    ticks: int

    def at(self, stamps_ns: NDArray[np.int64]) -> Ticks:
        """Return the tick nearest to each stamp, whether or not it is one of the flight's."""
        return (stamps_ns - self.epoch_ns + TICK_NS // 2) // TICK_NS

    def seconds(self, times_ns: Any) -> Array:
        return np.asarray((np.asarray(times_ns, np.int64) - self.epoch_ns) * 1e-9)

    def smooth(self, stamps_ns: NDArray[np.int64], values: Array) -> Array:
        """Return (ticks, k): straight lines between the values; beyond them, the nearest."""
        at, last = self._last_at(stamps_ns)
        every = np.arange(self.ticks)
        return np.column_stack([np.interp(every, at, column) for column in values[last].T])

    def held(self, stamps_ns: NDArray[np.int64], values: Array) -> Array:
        """Return (ticks, k): each value until the next one; the first also before it."""
        at, last = self._last_at(stamps_ns)
        row = np.searchsorted(at, np.arange(self.ticks), side="right") - 1
        return np.asarray(values[last][np.maximum(row, 0)], np.float64)

    def _last_at(self, stamps_ns: NDArray[np.int64]) -> tuple[Ticks, NDArray[np.intp]]:
        """Return the ticks that have a value, rising, and the row of the last one at each."""
        at = self.at(stamps_ns)
        found, first_of_reversed = np.unique(at[::-1], return_index=True)
        return found, at.size - 1 - first_of_reversed


class _RecordedFlight:
    """Builds the record of one flight from its topics."""

    def __init__(
        self, path: Path, tables: Mapping[str, ColumnTable], metadata: Mapping[str, str]
    ) -> None:
        self._tables = tables
        self._track: PoseTrack | None = None
        """The measured track, where there is no ground truth."""
        self._clock: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
        if (truth := tables.get(TRUE_ODOMETRY.name)) is not None:
            known = truth["stamp_ns"]
            self._clock = truth["publish_time_ns"], known
        else:
            self._track = _mocap_track(path, tables)
            known = self._track.stamps_ns
        self._flown, self._scenario = _scenario(path, metadata)
        lead_ns = _FIRST_STEP_NS + round(
            SECOND_NS * _FIRST_POSES / self._scenario.estimator.mocap_rate
        )
        epoch = _epoch(metadata, tables, known, lead_ns)
        last = int(known.max())
        if IMU.name in tables:
            last_imu = int(tables[IMU.name]["stamp_ns"].max())
            last = max(last, min(last_imu, last + _BEYOND_NS))
        ticks = (last - epoch + TICK_NS // 2) // TICK_NS + 1
        if not 0 < ticks < memory_limit() // _TICK_BYTES:
            raise InputError(
                f"'{path}' has {ticks * TICK_S:.0f} s from its first stamp to its last; accepted: "
                "the stamps of one flight"
            )
        self._grid = _Grid(epoch, ticks)

    def record(self, wall_time_s: float) -> FlightRecord:
        log = self._log()
        t: Array = np.arange(self._grid.ticks, dtype=np.float64) * TICK_S
        detections, arrivals = self._detections()
        if self._track is not None:
            self._assume_contact(log, detections)
        reactions, switches = self._reactions()
        events = collision_events(detections, arrivals, reactions, switches)
        phases = log["mode"][:, 0]
        changes = np.flatnonzero(phases[1:] != phases[:-1]) + 1
        events += [phase_event(t[k], phases[k]) for k in changes]
        seed = int(self._flown.get("seed", 0))
        known = (detections, arrivals, reactions, wall_time_s)
        summary, seen = summarize(MetricsInput(self._scenario, seed, t, log, *known))
        if self._track is not None:
            summary, seen = _without_truth(summary, seen)
        self._find_obstacle()
        captured: Array = np.zeros(0)
        arrival: Array = np.zeros(0)
        position: Array = np.zeros((0, 3))
        attitude: Array = np.zeros((0, 4))
        if (poses := self._tables.get(MOCAP_POSE.name)) is not None:
            captured = self._grid.seconds(poses["stamp_ns"])
            arrival = self._to_flight_time(poses["log_time_ns"])
            position, attitude = _vectors(poses, "pose.position"), _turn(poses, "pose.orientation")
        return FlightRecord(
            t=t,
            log=log,
            mocap_t=captured,
            mocap_arrival=arrival,
            mocap_position=position,
            mocap_attitude=attitude,
            detector_statistic=self._statistic(captured),
            events=sorted(events + seen, key=lambda event: float(event["time_s"])),
            scenario=self._flown,
            summary=summary,
            epoch_ns=self._grid.epoch_ns,
        )

    def _to_flight_time(self, log_times_ns: NDArray[np.int64]) -> Array:
        """Return the flight time [s] of moments on the recorder's clock.

        In simulated time that clock is another one: the truth tells both, its stamp and when it
        was published. A real vehicle flies in real time.
        """
        if self._clock is None:
            return self._grid.seconds(log_times_ns)
        published, stamps = self._clock
        there = np.maximum.accumulate(published)
        first = int(there[0])  # floats have no room for nanoseconds since 1970
        asked, rising, flight = log_times_ns - first, there - first, self._grid.seconds(stamps)
        span = max(float(rising[-1]), 1.0)
        rate = (flight[-1] - flight[0]) / span
        beyond = np.minimum(asked, 0.0) + np.maximum(asked - rising[-1], 0.0)
        return np.asarray(np.interp(asked, rising, flight) + rate * beyond)

    def _log(self) -> dict[str, Array]:
        log = {
            name: np.full((self._grid.ticks, *one.shape), math.nan)
            for name, one in LogRow.fields.items()
        }
        if self._track is None:
            self._pose(log, TRUE_ODOMETRY.name, ("position", "attitude", "velocity", "rates"))
        else:
            self._fill_from_mocap(log, self._track)
        self._pose(log, ODOMETRY.name, ("est_position", "est_attitude", "est_velocity", ""))
        self._rotors(log)
        self._contact(log)
        # The log holds what the controller follows: a set point of tick k reaches it at k + 1.
        held = (
            (IMU.name, "gyro", "angular_velocity", 0),
            (IMU.name, "accel", "linear_acceleration", 0),
            (SETPOINT.name, "position_setpoint", "position", TICK_NS),
            (SETPOINT.name, "velocity_setpoint", "velocity", TICK_NS),
            (SETPOINT.name, "acceleration_setpoint", "acceleration", TICK_NS),
            (RATES_SETPOINT.name, "rates_setpoint", "rates", 0),
        )
        for topic, column, path, transport_ns in held:
            if (table := self._tables.get(topic)) is not None:
                log[column] = self._grid.held(
                    table["stamp_ns"] + transport_ns, _vectors(table, path)
                )
        if (table := self._tables.get(ATTITUDE_SETPOINT.name)) is not None:
            stamps = table["stamp_ns"]
            log["attitude_setpoint"] = self._grid.held(stamps, _turn(table, "orientation"))
            log["thrust_setpoint"] = self._grid.held(stamps, _column(table, "thrust"))
        if (table := self._tables.get(ROTOR_COMMAND.name)) is not None:
            log["rotor_command"] = self._grid.held(table["stamp_ns"], table["speed"])
        if (table := self._tables.get(BATTERY.name)) is not None:
            both = np.column_stack([-table["current"], table["voltage"]])
            log["battery"][:, 1:] = self._grid.held(table["stamp_ns"], both)
        log["mode"] = self._phases()
        return log

    def _fill_from_mocap(self, log: dict[str, Array], track: PoseTrack) -> None:
        """Fill in the track of the motion capture, and the rates of the gyro."""
        stamps = track.stamps_ns
        log["position"] = self._grid.smooth(stamps, track.position)
        log["velocity"] = self._grid.smooth(stamps, track.velocity)
        log["attitude"] = self._grid.smooth(stamps, unwrap_quaternions(track.attitude))
        log["attitude"] /= np.linalg.norm(log["attitude"], axis=1, keepdims=True)
        if (table := self._tables.get(IMU.name)) is not None:
            rates = _vectors(table, "angular_velocity")
            log["rates"] = self._grid.held(table["stamp_ns"], rates)

    def _assume_contact(self, log: dict[str, Array], detections: list[CollisionEvent]) -> None:
        """Take the first contact from the detector."""
        for event in detections:
            at = round(event.contact_time_s / TICK_S)
            if event.trigger == "innovation" and 0 <= at < self._grid.ticks:
                log["contact"][at, 0] = 1.0
                return

    def _pose(self, log: dict[str, Array], topic: str, names: tuple[str, ...]) -> None:
        """Fill in a pose in map and a twist in base_link, its velocity turned into map."""
        table = self._tables.get(topic)
        if table is None:
            return
        stamps = table["stamp_ns"]
        turn = _turn(table, "pose.pose.orientation")
        back = conjugate(turn)
        values = (
            _vectors(table, "pose.pose.position"),
            unwrap_quaternions(turn),
            map_to_body(back, _vectors(table, "twist.twist.linear")),
            _vectors(table, "twist.twist.angular"),
        )
        for name, value in zip(names, values, strict=True):
            if name:
                log[name] = self._grid.smooth(stamps, value)
        log[names[1]] /= np.linalg.norm(log[names[1]], axis=1, keepdims=True)

    def _rotors(self, log: dict[str, Array]) -> None:
        table = self._tables.get(TRUE_ROTORS.name)
        if table is not None:
            names = {"rotor_speed": "speed", "rotor_thrust": "thrust"}
            for name in (*names, "fold", "damage"):
                log[name] = self._grid.smooth(table["stamp_ns"], table[names.get(name, name)])

    def _contact(self, log: dict[str, Array]) -> None:
        """Mark the ticks with contact."""
        log["contact"][:], log["contact_force"][:] = 0.0, 0.0
        table = self._tables.get(TRUE_CONTACT.name)
        if table is None:
            return
        at = self._grid.at(table["stamp_ns"])
        there = table["in_contact"].astype(bool) & (at >= 0) & (at < self._grid.ticks)
        at = at[there]
        log["contact"][at, 0] = 1.0
        log["contact"][at, 1] = table["rotor"][there]
        log["contact"][at, 2:5] = _vectors(table, "point")[there]
        log["contact_force"][at] = _vectors(table, "force")[there]

    def _phases(self) -> Array:
        """Return the phase of the set point followed, a tick after it was published.

        Where no set points were recorded, it is the mission's phase; that it has landed may come
        after the last of them. While PX4 lands by its own mode, the vehicle follows that.
        """
        phases: Array = np.full((self._grid.ticks, 1), float(Phase.IDLE))
        for name, delay_ns in ((SETPOINT.name, TICK_NS), (MISSION_STATUS.name, 0)):
            if (table := self._tables.get(name)) is not None:
                stamps = table["stamp_ns"] + delay_ns
                phases = self._grid.held(stamps, _column(table, "phase"))
                phases[: max(int(self._grid.at(stamps).min()), 0)] = Phase.IDLE
                break
        setpoints, status = (self._tables.get(s.name) for s in (SETPOINT, MISSION_STATUS))
        if setpoints is not None and status is not None and status["phase"][-1] == Phase.LANDED:
            landed_ns = status["stamp_ns"][-1:]
            if landed_ns[0] > setpoints["stamp_ns"].max():
                phases[max(int(self._grid.at(landed_ns)[0]), 0) :] = Phase.LANDED
        if (px4 := self._tables.get(PX4_STATUS.name)) is not None:
            own = self._grid.held(px4["stamp_ns"], _px4_landings(px4)[:, None])
            phases = np.where(np.isfinite(own) & (phases != Phase.LANDED), own, phases)
        return phases

    def _detections(self) -> tuple[list[CollisionEvent], list[float]]:
        """Return detector's and reaction's collisions, and when each was known [s]."""
        topics = {COLLISION_EVENT.name, *self._scenario.reaction.event_topics()}
        found = [pair for topic in topics for pair in self._events(topic)]
        found.sort(key=itemgetter(1))
        return [seen for seen, _ in found], [at_s for _, at_s in found]

    def _events(self, topic: str) -> list[tuple[CollisionEvent, float]]:
        table = self._tables.get(topic)
        if table is None:
            return []
        stamps = self._grid.seconds(table["stamp_ns"])
        contact_ns = table["contact_stamp.sec"].astype(np.int64) * SECOND_NS
        contacts = self._grid.seconds(contact_ns + table["contact_stamp.nanosec"])
        x_c, direction = _vectors(table, "contact_position"), _vectors(table, "flight_direction")
        events = [
            CollisionEvent(
                float(stamps[i]),
                _NAME_OF_TRIGGER.get(int(table["trigger"][i]), "unknown"),
                float(contacts[i]),
                x_c[i],
                direction[i],
                float(table["confidence"][i]),
                float(table["statistic"][i]),
                int(table["count"][i]),
                int(table["rotor"][i]) if "rotor" in table else ROTOR_UNKNOWN,
            )
            for i in range(stamps.size)
        ]
        known = self._to_flight_time(table["log_time_ns"])
        return [(seen, float(at)) for seen, at in zip(events, known, strict=True)]

    def _reactions(self) -> tuple[list[Decision], list[float]]:
        """Return the switches of the set point, and when each was made."""
        table = self._tables.get(REACTION_STATUS.name)
        if table is None:
            return [], []
        since = self._grid.seconds(table["stamp_ns"])
        x_c, x_r, n_r = (_vectors(table, name) for name in ("x_c", "x_r", "n_r"))
        found: list[Decision] = []
        times: list[float] = []
        known = 0
        for i in range(since.size):
            count = int(table["collisions"][i])
            if int(table["state"][i]) == ReactionPhase.REACTING and count > known:
                known = count
                found.append(Decision(x_c[i], n_r[i], x_r[i]))
                times.append(float(since[i]))
        return found, times

    def _statistic(self, captured_s: Array) -> Array:
        """Return the detector's statistic of each pose, 0 where there is none."""
        result: Array = np.zeros(captured_s.size)
        table = self._tables.get(DETECTOR_STATUS.name)
        if table is not None:
            at = np.rint(1e6 * self._grid.seconds(table["stamp_ns"])).astype(np.int64)
            statistic = dict(zip(at.tolist(), table["statistic"].tolist(), strict=True))
            wanted = np.rint(1e6 * captured_s).astype(np.int64)
            result[:] = [statistic.get(stamp, 0.0) for stamp in wanted.tolist()]
        return result

    def _find_obstacle(self) -> None:
        """Take the obstacle from the markers: its place depends on the seed."""
        table = self._tables.get(MARKERS.name)
        names = None if table is None else table.get("markers[0].ns")
        if table is None or names is None or not (names == "obstacle").any():
            return
        i = int(np.argmax(names == "obstacle"))
        fields = ("pose.position.x", "pose.position.y", "scale.x", "scale.z")
        x, y, width, top = (float(table[f"markers[0].{field}"][i]) for field in fields)
        self._flown["obstacle"] = {"x_m": x, "y_m": y, "radius_m": 0.5 * width, "top_m": top}


def _mocap_track(path: Path, tables: Mapping[str, ColumnTable]) -> PoseTrack:
    """Return the track that the motion capture has measured.

    Raises:
        InputError: it has not.
    """
    table = tables.get(MOCAP_POSE.name)
    track = None
    if table is not None:
        place, turn = _vectors(table, "pose.position"), _turn(table, "pose.orientation")
        track = pose_track(table["stamp_ns"], place, turn)
    if track is None:
        raise InputError(
            f"'{path}': nothing on {TRUE_ODOMETRY.name}, and no poses on {MOCAP_POSE.name}; "
            "accepted: a recording of a flight"
        )
    return track


def _without_truth(
    summary: dict[str, Any], events: list[dict[str, Any]]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Remove figures that need the ground truth, and mark them as missing."""
    unknown = (
        *("contact_point_m", "contact_rotor", "detection_latency_s", "strikes"),
        *("peak_contact_force_n", "rotors_broken"),
    )
    result = {**summary, **dict.fromkeys(unknown), "known_from": "mocap"}
    words = {"contact": "contact, as the detector has it"}
    return result, [{**e, "text": words.get(str(e["kind"]), e["text"])} for e in events]


def _epoch(
    metadata: Mapping[str, str],
    tables: Mapping[str, ColumnTable],
    stamps: NDArray[np.int64],
    lead_ns: int,
) -> int:
    """Return the stamp of the flight's tick 0, where what is known has these stamps.

    The mission's first word comes `lead_ns` after the beginning at most.
    """
    known = metadata.get("epoch_ns", "")
    if known.isascii() and known.isdecimal() and len(known) < _DIGITS:
        return int(known)
    first = int(stamps.min())
    mission = tables.get(MISSION_STATUS.name)
    if mission is None:
        return first
    began = int(mission["stamp_ns"].min()) - lead_ns
    ticks = (min(max(began, first), int(stamps.max())) - first + TICK_NS - 1) // TICK_NS
    return first + ticks * TICK_NS


def _scenario(path: Path, metadata: Mapping[str, str]) -> tuple[dict[str, Any], Scenario]:
    """Return the scenario as flown, and as a scenario again; defaults if the file has none.

    Raises:
        InputError: what the file has is none.
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
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        why = error if isinstance(error, InputError) else "it is none"
        raise InputError(f"'{path}': its scenario can't be used: {why}") from error


def _vectors(table: ColumnTable, path: str, axes: str = "xyz") -> Array:
    """Return the fields below a path as rows.

    Raises:
        InputError: the topic has none.
    """
    _ = table[f"{path}.{axes[0]}"]
    return vectors(table, path, axes)


def _px4_landings(status: ColumnTable) -> Array:
    """Return the phase at each status of PX4 (n): LAND, LANDED after it, NaN where it flies on."""
    found = np.full(len(status["mode"]), np.nan)
    phase = math.nan
    for i, (armed, mode) in enumerate(zip(status["armed"], status["mode"], strict=True)):
        if armed:
            phase = float(Phase.LAND) if mode in _PX4_LANDS else math.nan
        elif phase == Phase.LAND:
            phase = float(Phase.LANDED)
        found[i] = phase
    return found


def _turn(table: ColumnTable, path: str) -> Array:
    return _vectors(table, path, "xyzw")


def _column(table: ColumnTable, path: str) -> Array:
    return np.asarray(table[path], np.float64).reshape(-1, 1)

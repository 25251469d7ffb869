"""A flight from a PX4 log (ULog)."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog
from pyulog.exceptions import ULogException

from tombo_bag.columns import stacked_columns
from tombo_bag.flight import Finding, Flight, Series, Topic, damage_findings
from tombo_bag.rotor_topics import moving, share_of_pulse
from tombo_bag.topics import ATTITUDE_SETPOINT, ODOMETRY, RATES_SETPOINT, SETPOINT
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_logs.readers.csv_log import converted
from tombo_logs.readers.csv_mapping import LogMapping
from tombo_px4.frames import enu_from_ned, flu_from_frd, ros_quaternion

Columns = Mapping[str, NDArray[Any]]
Topics = Mapping[str, Columns]

MAGIC = ULog.HEADER_BYTES[:4]
_POSES = ("vehicle_visual_odometry", "vehicle_mocap_odometry", "vehicle_odometry")
"""Best first: the first two are what the motion capture sent, the last is the estimate."""
PX4_TOPICS = (
    *_POSES,
    "vehicle_local_position",
    "vehicle_attitude",
    "sensor_combined",
    "vehicle_angular_velocity",
    "vehicle_acceleration",
    "actuator_motors",
    "actuator_outputs",
    "esc_status",
    "battery_status",
    "vehicle_local_position_setpoint",
    "vehicle_attitude_setpoint",
    "vehicle_rates_setpoint",
    "estimator_innovation_test_ratios",
    "vehicle_status",
)
_MOVING = {
    "actuator_outputs": tuple(f"output[{i}]" for i in range(4)),
    "battery_status": ("voltage_v",),
}
"""Topics with an instance for each driver or battery → fields by which the right one is told."""
_LATER_S = 1e-3
"""s by which a sample may be later than its message: two stamps of one clock are so close."""
_RPM = np.pi / 30.0
_MOTOR_1 = 101
"""actuator_function of the first motor."""
_MODES = {
    **{0: "manual", 1: "altitude", 2: "position", 3: "mission", 4: "hold", 5: "return"},
    **{10: "acro", 12: "descend", 13: "termination", 14: "offboard", 15: "stabilized"},
    **{17: "take-off", 18: "land", 20: "precision landing"},
}
_ARMING = {1: "disarmed", 2: "armed"}
"""Numbers of PX4's VehicleStatus.msg, v1.17."""
_BROKEN = (ULogException, struct.error, IndexError, KeyError, ValueError, TypeError,
           AttributeError, OverflowError)  # fmt: skip
"""Errors of pyulog for another file format, or a file that ends within its definitions."""


def read_ulog(path: Path, name: str, mapping: LogMapping | None = None) -> Flight:
    """Read a PX4 log (`.ulg`) under a name for the flight.

    Of a mapping, channels with a topic replace what is read by name.

    Raises:
        InputError: no ULog, one without position and attitude, or without a topic of the mapping.
    """
    mapped = {} if mapping is None else mapping.by_topic
    log, cut = _opened(path, [*PX4_TOPICS, *(topic.strip("/") for topic in mapped)])
    topics, findings = _instances(name, log)
    findings += damage_findings(name, path, _damage(log, cut))
    topics, more = possible_stamps(name, topics)
    findings += more
    start = float(log.start_timestamp)
    series, source = px4_series(topics, start, log.initial_parameters)
    for topic, channels in mapped.items():
        table = topics.get(topic.strip("/"))
        if mapping is None or table is None:
            raise unknown_name(f"topic in '{path}'", topic, topics)
        for key, channel in channels.items():
            values = stacked_columns(table, channel.columns, f"'{path}'")
            series[key] = Series(_captured(table, start), converted(key, channel, mapping, values))
    if not {"position", "attitude"} <= set(series):
        there = ", ".join(sorted({d.name for d in log.data_list})) or "none of the topics"
        raise InputError(
            f"'{path}' has no poses; needed: position and attitude, as {', '.join(_POSES)} or "
            f"vehicle_local_position with vehicle_attitude; of these it has {there}"
        )
    findings += pose_findings(name, source)
    flight = Flight.measured(
        name=name,
        source=f"{path} (PX4 log, poses from {source})",
        series={key: s for key, s in series.items() if s.t.size},
        findings=tuple(findings),
        events=_mode_changes(topics.get("vehicle_status", {}), start),
    )
    return replace(flight, topics={**_control_topics(topics, start), **flight.topics})


def px4_series(
    topics: Topics, start: float, parameters: Mapping[str, Any] | None = None
) -> tuple[dict[str, Series], str]:
    """Return channels of PX4 topics, and where the poses are from (empty: there are none).

    Args:
        topics: name of a uORB topic → its fields, each (N,), times in us.
        start: time that is zero [us].
        parameters: of the autopilot, for the places of the motors.
    """
    series: dict[str, Series] = {}
    source = _poses(topics, series, start)
    for reader in (_imu, _motors, _escs, _battery):
        reader(topics, series, start)
    order = motor_order(parameters or {})
    for key in {"motor_command", "rotor_speed"} & set(series):
        series[key] = replace(series[key], values=series[key].values[:, order])
    return {key: s for key, s in series.items() if s.t.size}, source


def pose_findings(flight: str, source: str) -> list[Finding]:
    """Report poses that are an estimate of the autopilot; `source` as `px4_series` returns it."""
    if source in ("", *_POSES[:2]):
        return []
    text = (
        f"position and attitude are the autopilot's {source}, smoothed with the IMU's; expected: "
        f"motion capture ({_POSES[0]})"
    )
    return [Finding("missing", "warning", flight, text, channel="position")]


def motor_order(parameters: Mapping[str, Any]) -> list[int]:
    """Return which motor of PX4 each of our rotors is, from `CA_ROTORn_PX` and `_PY`.

    Without these parameters, or for other than four rotors in an X: PX4's numbering of a quad-X,
    which is ours (PX4 user guide, "Actuator Configuration and Testing"; ArduCopter's is the same).
    """
    quadrants = {(True, True): 0, (False, False): 1, (True, False): 2, (False, True): 3}
    order = {}
    for motor in range(4):
        x, y = (_number(parameters.get(f"CA_ROTOR{motor}_P{a}")) for a in "XY")
        if x and y:  # forward and to the right
            order[quadrants[x > 0.0, y > 0.0]] = motor
    return [order[i] for i in range(4)] if len(order) == 4 else [0, 1, 2, 3]


def _number(value: object) -> float:
    """Return a parameter, 0 where it is none: a damaged log may hold a text."""
    return float(value) if isinstance(value, int | float) else 0.0


def _opened(path: Path, topics: list[str]) -> tuple[Any, bool]:
    """Return what `pyulog` reads of a log, and whether it ends within a message."""
    try:
        raw = path.read_bytes()
        with contextlib.redirect_stdout(io.StringIO()):
            return ULog(io.BytesIO(raw), message_name_filter_list=topics), _is_cut(raw)
    except OSError as error:
        raise InputError(f"can't read '{path}': {error.strerror}") from error
    except InputError:
        raise
    except _BROKEN as error:
        why = " ".join(str(error).split())[:120]
        raise InputError(f"'{path}' is not a whole ULog ({why}); accepted: a PX4 log") from error


def _is_cut(raw: bytes) -> bool:
    """Return whether a log ends within a message: head of 16 bytes, then size, kind, content."""
    at = 16
    while at + 3 <= len(raw):
        at += 3 + (raw[at] | raw[at + 1] << 8)
    return at != len(raw)


def _damage(log: Any, cut: bool) -> list[str]:
    lines = []
    if log.file_corruption:
        lines.append("damaged; what is whole is read")
    elif cut:
        lines.append("cut off within a message; read up to there")
    lost = sum(d.duration for d in log.dropouts)
    if lost:
        lines.append(f"{len(log.dropouts)} dropouts of the logger, {lost / 1e3:.1f} s together")
    return lines


def _instances(flight: str, log: Any) -> tuple[dict[str, Columns], list[Finding]]:
    """Return each topic in its first instance, or in the one that moves with the flight."""
    every: dict[str, dict[int, Columns]] = {}
    for data in sorted(log.data_list, key=lambda d: d.multi_id):
        if len(data.data.get("timestamp", ())):
            every.setdefault(data.name, {})[data.multi_id] = data.data
    topics, findings = {}, []
    for name, tables in every.items():
        numbers = list(tables)
        chosen = numbers[0]
        if name in _MOVING and len(numbers) > 1:
            columns = [_columns(table, *_MOVING[name]) for table in tables.values()]
            chosen = numbers[moving([np.zeros((0, 1)) if c is None else c for c in columns])]
        if chosen != numbers[0]:
            text = f"{name}: instance {chosen} of {len(numbers)} is read: it moves with the flight"
            findings.append(
                Finding("rpm", "info", flight, text, channel=name, key="instance",
                        numbers=(float(chosen),))
            )  # fmt: skip
        topics[name] = tables[chosen]
    return topics, findings


def possible_stamps(flight: str, topics: Topics) -> tuple[dict[str, Columns], list[Finding]]:
    """Return topics without the times of samples that would be later than their messages."""
    possible, findings = dict(topics), []
    for name, table in topics.items():
        sample = table.get("timestamp_sample")
        if sample is None or not np.any(sample):
            continue
        later = float(np.median(np.asarray(sample, np.float64) - table["timestamp"])) * 1e-6
        if later <= _LATER_S:
            continue
        possible[name] = {
            key: column for key, column in table.items() if key != "timestamp_sample"
        }
        text = (
            f"{name}: timestamp_sample is {later:.3g} s later than timestamp; expected: earlier, "
            "by the latency; another clock; timestamp is taken instead"
        )
        findings.append(
            Finding("stamps", "warning", flight, text, channel=name, key="sample later",
                    numbers=(later,))
        )  # fmt: skip
    return possible, findings


def _seconds(table: Mapping[str, NDArray[Any]], start: float, key: str = "timestamp") -> Array:
    return (np.asarray(table[key], np.float64) - start) * 1e-6


def _captured(table: Mapping[str, NDArray[Any]], start: float) -> Array:
    """Return times of capture [s]: `timestamp_sample` where it is filled in."""
    sample = table.get("timestamp_sample")
    if sample is None or not np.any(sample):
        return _seconds(table, start)
    return np.where(sample > 0, _seconds(table, start, "timestamp_sample"), _seconds(table, start))


def _columns(table: Mapping[str, NDArray[Any]], *names: str) -> Array | None:
    if not all(name in table for name in names):
        return None
    return np.column_stack([np.asarray(table[name], np.float64) for name in names])


def _array(table: Mapping[str, NDArray[Any]], name: str, width: int) -> Array | None:
    return _columns(table, *_indexed(name, width))


def _poses(topics: Topics, series: dict[str, Series], start: float) -> str:
    """Fill in position and attitude; return where they are from, or nothing."""
    for name in _POSES:
        table = topics.get(name, {})
        position = _array(table, "position", 3)
        if position is None:
            position = _columns(table, "x", "y", "z")  # up to PX4 1.13
        attitude = _array(table, "q", 4)
        if position is None or attitude is None or not np.isfinite(position).any():
            continue
        t = _captured(table, start)
        # an estimate does not arrive; poses of the motion capture arrived at `timestamp`
        arrival = None if name == "vehicle_odometry" else _seconds(table, start)
        series["position"] = Series(t, enu_from_ned(position), arrival)
        series["attitude"] = Series(t, _attitudes(attitude), arrival)
        return "vehicle_odometry (its estimate)" if name == "vehicle_odometry" else name
    local, turn = topics.get("vehicle_local_position", {}), topics.get("vehicle_attitude", {})
    position, attitude = _columns(local, "x", "y", "z"), _array(turn, "q", 4)
    if position is None or attitude is None:
        return ""
    series["position"] = Series(_captured(local, start), enu_from_ned(position))
    series["attitude"] = Series(_captured(turn, start), _attitudes(attitude))
    return "vehicle_local_position and vehicle_attitude (its estimate)"


def _imu(topics: Topics, series: dict[str, Series], start: float) -> None:
    table = topics.get("sensor_combined", {})
    gyro, accel = _array(table, "gyro_rad", 3), _array(table, "accelerometer_m_s2", 3)
    if gyro is not None and accel is not None:
        t = _seconds(table, start)
        # means over an interval that ends at the stamp: they are of its middle
        series["gyro"] = Series(t - _half_interval(table, "gyro_integral_dt"), flu_from_frd(gyro))
        shift = np.asarray(table.get("accelerometer_timestamp_relative", np.zeros(1)), np.float64)
        shift = np.where(np.abs(shift) < 1e6, shift, np.nan) * 1e-6
        middle = t + shift - _half_interval(table, "accelerometer_integral_dt")
        series["accel"] = Series(middle, flu_from_frd(accel))
        return
    for channel, name in (("gyro", "vehicle_angular_velocity"), ("accel", "vehicle_acceleration")):
        values = _array(topics.get(name, {}), "xyz", 3)
        if values is not None:
            series[channel] = Series(_captured(topics[name], start), flu_from_frd(values))


def _attitudes(wxyz: Array) -> Array:
    """Return (N, 4) xyzw, map from base_link, that change sign nowhere."""
    return unwrap_quaternions(ros_quaternion(wxyz))


def _largest(values: Array) -> Array:
    """Return (N, 1), the largest of each row."""
    return np.asarray(values.max(axis=1, keepdims=True))


def _indexed(name: str, width: int) -> tuple[str, ...]:
    """Return the names of the columns of an array."""
    return tuple(f"{name}[{i}]" for i in range(width))


_XYZ, _RATES = ("x", "y", "z"), ("roll", "pitch", "yaw")
_WANTED = _indexed("q_d", 4)
_RATIOS = ("ev_hpos[0]", "ev_hpos[1]", "ev_vpos")
_CONTROL: tuple[tuple[str, str, str, tuple[str, ...], Callable[[Array], Array]], ...] = (
    (ODOMETRY.name, "position", "vehicle_local_position", _XYZ, enu_from_ned),
    (SETPOINT.name, "position", "vehicle_local_position_setpoint", _XYZ, enu_from_ned),
    (ATTITUDE_SETPOINT.name, "orientation", "vehicle_attitude_setpoint", _WANTED, _attitudes),
    (RATES_SETPOINT.name, "rates", "vehicle_rates_setpoint", _RATES, flu_from_frd),
    ("/estimator/innovation", "ratio", "estimator_innovation_test_ratios", _RATIOS, _largest),
)
"""What PX4 estimated and asked for: topic and field here, topic and fields there, and the turn."""


def _control_topics(topics: Topics, start: float) -> dict[str, Topic]:
    """Return what PX4 estimated and asked for, as the suite's topics; map ENU, base_link FLU."""
    return {
        topic: Topic.of(_seconds(topics[source], start), {field: turn(values)})
        for topic, field, source, names, turn in _CONTROL
        if (values := _columns(topics.get(source, {}), *names)) is not None
    }


def _mode_changes(table: Mapping[str, NDArray[Any]], start: float) -> list[dict[str, Any]]:
    """Return changes of PX4's flight mode and of its arming as events."""
    events: list[dict[str, Any]] = []
    for name, words in (("nav_state", _MODES), ("arming_state", _ARMING)):
        values = table.get(name)
        if values is None:
            continue
        t = _seconds(table, start)
        for i in [0, *(np.flatnonzero(np.diff(values)) + 1)]:
            text = words.get(int(values[i]), str(int(values[i])))
            events.append({"time_s": float(t[i]), "kind": name, "text": text})
    return sorted(events, key=lambda event: event["time_s"])


def _half_interval(table: Mapping[str, NDArray[Any]], name: str) -> Array:
    interval = np.asarray(table.get(name, np.zeros(1)), np.float64)
    return 0.5e-6 * np.where((interval > 0.0) & (interval < 1e5), interval, 0.0)


def _motors(topics: Topics, series: dict[str, Series], start: float) -> None:
    table = topics.get("actuator_motors", {})
    values = _array(table, "control", 4)
    if values is not None:
        # not a number: the motor is off
        values = np.where(np.isfinite(values), values, 0.0)
        series["motor_command"] = Series(_captured(table, start), values)
        return
    table = topics.get("actuator_outputs", {})
    pulses = _array(table, "output", 4)
    share = None if pulses is None else share_of_pulse(pulses)
    if share is not None:
        series["motor_command"] = Series(_captured(table, start), share)


def _escs(topics: Topics, series: dict[str, Series], start: float) -> None:
    table = topics.get("esc_status", {})
    speeds = _columns(table, *(f"esc[{i}].esc_rpm" for i in range(4)))
    if speeds is None:
        return
    order = [0, 1, 2, 3]
    functions = _columns(table, *(f"esc[{i}].actuator_function" for i in range(4)))
    if functions is not None:
        motors = [int(f) - _MOTOR_1 for f in functions[-1] if np.isfinite(f)]
        if sorted(motors) == order:
            order = [motors.index(i) for i in range(4)]
    if np.any(speeds):
        speed = np.abs(speeds[:, order]) * _RPM
        series["rotor_speed"] = Series(_captured(table, start), speed)


def _battery(topics: Topics, series: dict[str, Series], start: float) -> None:
    table = topics.get("battery_status", {})
    for channel, letter in (("voltage", "v"), ("current", "a")):
        for name in (f"{channel}_{letter}", f"{channel}_filtered_{letter}"):
            values = _columns(table, name)
            if values is None:
                continue
            usable = values > 0.5 if channel == "voltage" else values >= 0.0  # -1: not measured
            if usable.mean() > 0.5:
                values = np.where(usable, values, np.nan)
                series[channel] = Series(_seconds(table, start), values)
                break

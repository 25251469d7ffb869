"""A flight from a telemetry log of QGroundControl, Mission Planner or MAVProxy (`.tlog`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tombo_bag.columns import ColumnTable
from tombo_bag.flight import Flight, damage_findings
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.readers.ulog import pose_findings, px4_series
from tombo_px4.telemetry_log import MOCAP, telemetry_messages


def read_tlog(path: Path, name: str) -> Flight:
    """Read a telemetry log of one vehicle under a name for the flight.

    Raises:
        InputError: no position and attitude in it.
    """
    messages, damage = telemetry_messages(path.read_bytes())
    topics: dict[str, ColumnTable] = {}
    for number, table in messages.items():
        topics = {**_as_topics(number, table), **topics}
    start = min((float(t["timestamp"][0]) for t in topics.values()), default=0.0)
    series, source = px4_series(topics, start)
    if not source:
        raise InputError(
            f"'{path}' has no poses; needed: position and attitude, as ATT_POS_MOCAP, "
            "ODOMETRY of a companion, VICON_POSITION_ESTIMATE, VISION_POSITION_ESTIMATE or "
            "LOCAL_POSITION_NED with "
            f"ATTITUDE; of these it has {', '.join(sorted(topics)) or 'none'}"
        )
    findings = [*damage_findings(name, path, damage), *pose_findings(name, source)]
    return Flight.measured(name, f"{path} (telemetry log)", series, findings=tuple(findings))


def _as_topics(number: int, table: ColumnTable) -> dict[str, ColumnTable]:
    times = {key: table[key] for key in ("timestamp", "timestamp_sample")}
    if "acc" in table:
        raw = number in (26, 27)  # mG and mrad/s
        gyro, accel = (1e-3, 1e-3 * GRAVITY) if raw else (1.0, 1.0)
        return {
            "vehicle_angular_velocity": times | _spread("xyz", gyro * table["gyro"]),
            "vehicle_acceleration": times | _spread("xyz", accel * table["acc"]),
        }
    if number in MOCAP or number in (30, 31):
        q = table.get("q", _quaternion(table["rpy"]) if "rpy" in table else None)
        posed = times | _spread("q", q)
        if number not in MOCAP:
            return {"vehicle_attitude": posed}
        return {"vehicle_visual_odometry": posed | _spread("position", table["position"])}
    if number == 32:
        x, y, z = table["position"].T
        return {"vehicle_local_position": times | {"x": x, "y": y, "z": z}}
    return _drives(number, table, times)


def _drives(number: int, table: ColumnTable, times: ColumnTable) -> dict[str, ColumnTable]:
    if number == 1:
        volts, amperes = 1e-3 * table["voltage"], 1e-2 * table["current"]
        return {"battery_status": times | {"voltage_v": volts, "current_a": amperes}}
    if number == 36:
        return {"actuator_outputs": times | _spread("output", table["output"])}
    if number == 93:
        return {"actuator_motors": times | _spread("control", table["control"])}
    rpm = {f"esc[{i}].esc_rpm": column for i, column in enumerate(table["rpm"].T)}
    return {"esc_status": times | rpm}


def _spread(name: str, values: NDArray[Any] | None) -> ColumnTable:
    """Return the columns of an array as PX4 names them."""
    columns = () if values is None else values.T
    return {f"{name}[{i}]": column for i, column in enumerate(columns)}


def _quaternion(rpy: NDArray[Any]) -> NDArray[Any]:
    """Return wxyz of roll, pitch and yaw [rad]."""
    return np.asarray(Rotation.from_euler("ZYX", rpy[:, ::-1]).as_quat()[:, [3, 0, 1, 2]])

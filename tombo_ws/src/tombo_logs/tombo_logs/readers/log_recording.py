"""A flight log as a recording (MCAP), as a lab's recorder would have written it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tombo_bag.columnar_cdr import lay_in, lay_in_times, layout
from tombo_bag.flight_time import nanoseconds
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.topics import BATTERY, IMU, MOCAP_POSE, ROTOR_COMMAND, TopicSpec
from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_BODY, FRAME_MAP
from tombo_logs.flight_log import FlightLog, Series
from tombo_logs.readers.bag_log import ROTOR_SPEED


def record_log(log: FlightLog, path: Path) -> None:
    """Write the channels of a log that the suite's topics can hold.

    Stamps are capture times; log times are the times of arrival, where they are known.

    Raises:
        InputError: the file can't be created.
        OSError: it can't be written.
    """
    with McapSink(path) as sink:
        sink.write_columns(*_columns(log.series, sink))


def _columns(series: Mapping[str, Series], sink: McapSink) -> list[Columns]:
    parts = []

    def add(
        spec: TopicSpec, name: str, frame: str, fields: Mapping[str, Array], first: Series
    ) -> None:
        captured = nanoseconds(first.t)
        known = captured if first.arrival is None else nanoseconds(first.arrival)
        order = np.argsort(known, kind="stable")
        records = layout(spec.typename, {"header": {"frame_id": frame}}).records(first.t.size)
        lay_in_times(records, "header.stamp", captured[order])
        for field, values in fields.items():
            lay_in(records, field, values[order])
        channel = sink.add_channel(name, spec.typename, spec.qos)
        parts.append(Columns(channel, known[order], records))

    def values(names: Mapping[str, str]) -> dict[str, Array]:
        return {field: series[channel].values for field, channel in names.items()}

    pose = {"pose.position": "position", "pose.orientation": "attitude"}
    add(MOCAP_POSE, MOCAP_POSE.name, FRAME_MAP, values(pose), series["position"])
    if "gyro" in series and "accel" in series:
        imu = values({"angular_velocity": "gyro", "linear_acceleration": "accel"})
        add(IMU, IMU.name, FRAME_BODY, imu, series["gyro"])
    for topic, channel in ((ROTOR_COMMAND.name, "rotor_command"), (ROTOR_SPEED, "rotor_speed")):
        if channel in series:
            speeds = values({"speed": channel})
            add(ROTOR_COMMAND, topic, FRAME_BODY, speeds, series[channel])
    if "voltage" in series:
        voltage = series["voltage"].values[:, 0]
        current = np.full_like(voltage, np.nan)
        fields = {"voltage": voltage, "current": current}
        add(BATTERY, BATTERY.name, FRAME_BODY, fields, series["voltage"])
    return parts

"""A measured flight as a recording (MCAP), as a lab's recorder would have written it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tombo_bag.channels import ROTOR_SPEED
from tombo_bag.columnar_cdr import lay_in, lay_in_times, layout
from tombo_bag.flight import Flight, Topic
from tombo_bag.flight_time import nanoseconds
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.topics import BATTERY, IMU, MOCAP_POSE, ROTOR_COMMAND, TopicSpec
from tombo_dynamics.frames import FRAME_BODY, FRAME_MAP

_FIELDS = {
    "position": "pose.position", "attitude": "pose.orientation",
    "gyro": "angular_velocity", "accel": "linear_acceleration",
    "speed": "speed", "voltage": "voltage", "current": "current",
}  # fmt: skip
"""Field of a topic → path in the message."""
_NEEDED = {
    MOCAP_POSE.name: {"position", "attitude"}, IMU.name: {"gyro", "accel"},
    ROTOR_COMMAND.name: {"speed"}, ROTOR_SPEED: {"speed"}, BATTERY.name: {"voltage"},
}  # fmt: skip
"""Topic → fields without which it is not written."""
_SPECS = {
    MOCAP_POSE.name: MOCAP_POSE, IMU.name: IMU, ROTOR_COMMAND.name: ROTOR_COMMAND,
    ROTOR_SPEED: ROTOR_COMMAND, BATTERY.name: BATTERY,
}  # fmt: skip


def record_log(log: Flight, path: Path) -> None:
    """Write the channels of a log that the suite's topics can hold.

    Stamps are capture times; log times are the times of arrival, where they are known.

    Raises:
        InputError: the file can't be created.
        OSError: it can't be written.
    """
    with McapSink(path) as sink:
        parts = [
            _columns(sink, spec, name, log.topics[name])
            for name, spec in _SPECS.items()
            if _NEEDED[name] <= set(log.topics.get(name, ()))
        ]
        sink.write_columns(*parts)


def _columns(sink: McapSink, spec: TopicSpec, name: str, topic: Topic) -> Columns:
    captured, arrived = nanoseconds(topic.t), nanoseconds(topic.arrival)
    order = np.argsort(arrived, kind="stable")
    frame = FRAME_MAP if spec is MOCAP_POSE else FRAME_BODY
    records = layout(spec.typename, {"header": {"frame_id": frame}}).records(topic.t.size)
    lay_in_times(records, "header.stamp", captured[order])
    for field, series in topic.items():
        values = series.values[:, 0] if spec is BATTERY else series.values
        sign = -1.0 if field == "current" else 1.0  # sensor_msgs: drawn is negative
        lay_in(records, _FIELDS[field], sign * values[order])
    if spec is BATTERY and "current" not in topic:
        lay_in(records, "current", np.full(topic.t.size, np.nan))
    return Columns(sink.add_channel(name, spec.typename, spec.qos), arrived[order], records)

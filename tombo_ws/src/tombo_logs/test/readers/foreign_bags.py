"""Recordings with messages of other projects, written by `rosbags` with their definitions."""

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

HEADER = "std_msgs/Header header\n"
DEFINITIONS = {
    "actuator_msgs/msg/Actuators": HEADER
    + "float64[] position\nfloat64[] velocity\nfloat64[] normalized\n",
    "mav_msgs/msg/Actuators": HEADER
    + "float64[] angles\nfloat64[] angular_velocities\nfloat64[] normalized\n",
    "mavros_msgs/msg/ESCStatusItem": HEADER + "int32 rpm\nfloat32 voltage\nfloat32 current\n",
    "mavros_msgs/msg/ESCStatus": HEADER + "mavros_msgs/ESCStatusItem[] esc_status\n",
    "mavros_msgs/msg/ESCTelemetryItem": "uint8 temperature\nuint16 voltage\nuint16 current\n"
    "uint16 totalcurrent\nuint16 rpm\nuint16 count\n",
    "mavros_msgs/msg/ESCTelemetry": "mavros_msgs/ESCTelemetryItem[] esc_telemetry\n",
    "mavros_msgs/msg/RCOut": HEADER + "uint16[] channels\n",
    "px4_msgs/msg/ActuatorMotors": "uint64 timestamp\nuint64 timestamp_sample\n"
    "uint16 reversible_flags\nfloat32[12] control\n",
    "px4_msgs/msg/EscReport": "uint64 timestamp\nint32 esc_rpm\nuint8 actuator_function\n",
    "px4_msgs/msg/EscStatus": "uint64 timestamp\nuint16 counter\npx4_msgs/EscReport[8] esc\n",
    "px4_msgs/msg/VehicleOdometry": "uint64 timestamp\nuint64 timestamp_sample\n"
    "float32[3] position\nfloat32[4] q\n",
}


def write_foreign(path, streams, ros1=False):
    """Streams: (topic, type, (N,) seconds, function of a row that gives nested fields)."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    added = {}
    for name, text in DEFINITIONS.items():
        added.update(get_types_from_msg(text, name))
    store.register(added)
    if ros1:
        writer, serialize = Ros1Writer(path), store.serialize_ros1
    else:
        writer = Ros2Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        serialize = store.serialize_cdr
    with writer:
        for topic, typename, times, fields in streams:
            connection = writer.add_connection(topic, typename, typestore=store)
            for i, t in enumerate(times):
                message = made(store, typename, {**stamp(t, typename), **fields(i)})
                writer.write(connection, round((t + 100.005) * 1e9), serialize(message, typename))
    return path


def stamp(t, typename):
    """The capture time in the header, 5 ms before the recording."""
    if not DEFINITIONS.get(typename, HEADER).startswith(HEADER):
        return {}
    return {"header": {"stamp": dict(zip(("sec", "nanosec"), divmod(round((t + 100) * 1e9), 10**9),
                                         strict=True))}}  # fmt: skip


def made(store, typename, values):
    """A message with fields given; all others are zero or empty."""
    fields = {}
    for name, (kind, content) in store.fielddefs[typename][1]:
        value = values.get(name)
        if kind == 1:
            zero = "" if content[0] == "string" else 0
            fields[name] = zero if value is None else value
        elif kind == 2:
            fields[name] = made(store, content, value or {})
        else:
            fields[name] = elements(store, kind, *content, value)
    return store.types[typename](**fields)


def elements(store, kind, element, size, value):
    if element[0] == 2:
        items = list(value or [])
        items += [{}] * (size - len(items) if kind == 3 else 0)
        return [made(store, element[1], item) for item in items]
    if element[1][0] == "string":
        return list(value or [])
    dtype = {"float32": "f4", "float64": "f8", "uint16": "u2"}[element[1][0]]
    filled = [] if value is None else list(value)
    return np.array(filled + [0] * (size - len(filled) if kind == 3 else 0), dtype)


def pose(log, topic="/mocap/pose"):
    """The stream of a flight's poses."""
    p, q = log.series["position"], log.series["attitude"].values
    return (
        topic,
        "geometry_msgs/msg/PoseStamped",
        p.t,
        lambda i: {
            "pose": {
                "position": dict(zip("xyz", p.values[i], strict=True)),
                "orientation": dict(zip("xyzw", q[i], strict=True)),
            }
        },
    )

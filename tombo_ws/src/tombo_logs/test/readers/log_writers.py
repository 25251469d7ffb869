"""Writes made flights as tables, recordings and PX4 logs."""

import struct

import numpy as np

from tombo_bag.columnar_cdr import layout
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.qos import SENSOR
from tombo_dynamics.time_base import EPOCH_NS
from tombo_px4.frames import ned_from_enu, px4_quaternion

SIZES = {
    "position": ("position_x", "position_y", "position_z"),
    "attitude": ("attitude_x", "attitude_y", "attitude_z", "attitude_w"),
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
    "accel": ("accel_x", "accel_y", "accel_z"),
    "rotor_speed": tuple(f"rotor_speed_{i}" for i in range(4)),
    "rotor_command": tuple(f"rotor_command_{i}" for i in range(4)),
    "voltage": ("voltage",),
}
"""Columns of the shipped mapping `generic`."""


def close(a, b, tolerance=1e-9):
    np.testing.assert_allclose(a, b, atol=tolerance)


def table_text(log, channels=SIZES, delimiter=",", epoch=100.0):
    """One row for each stamp of any channel; missing values of a row are empty."""
    stamps = np.unique(np.concatenate([log.series[c].t for c in channels]))
    names = [n for c in channels for n in SIZES[c]]
    cells = np.full((stamps.size, len(names)), np.nan)
    column = 0
    for c in channels:
        series = log.series[c]
        rows = np.searchsorted(stamps, series.t)
        width = series.values.shape[1]
        cells[rows, column : column + width] = series.values
        column += width
    lines = [delimiter.join(["t", *names])]
    for t, row in zip(stamps, cells, strict=True):
        texts = ["" if np.isnan(x) else repr(float(x)) for x in row]
        lines.append(delimiter.join([f"{t + epoch:.6f}", *texts]))
    return "\n".join(lines) + "\n"


def stamped(records, key, t, shift_ns=0):
    ns = EPOCH_NS + shift_ns + np.round(t * 1e9).astype(np.int64)
    records[f"{key}.sec"], records[f"{key}.nanosec"] = ns // 10**9, ns % 10**9
    return ns


def write_bag(path, log, namespace="", pose="geometry_msgs/msg/PoseStamped", topic="/mocap/pose",
              latency=0.01, pose_clock_ns=0, truth=False):  # fmt: skip
    """An MCAP with poses, IMU, commands and battery; `truth`: a wrong ground truth as well."""
    p, q = log.series["position"], log.series["attitude"].values
    with McapSink(path) as sink:
        parts = []

        def add(name, typename, series, fields, late=0.0, shift_ns=0):
            t = series.t
            records = layout(typename, {}).records(t.size)
            stamped(records, "header.stamp", t, shift_ns)
            for field, column in fields.items():
                records[field] = column
            logged = EPOCH_NS + np.round((t + late) * 1e9).astype(np.int64)
            channel = sink.add_channel(namespace + name, typename, SENSOR)
            data = records.tobytes()
            size = records.dtype.itemsize
            messages = [data[i : i + size] for i in range(0, len(data), size)]
            parts.append(Columns(channel, logged, messages))

        def lay(prefix, values):
            return {prefix + letter: c for letter, c in zip("xyzw", values.T, strict=False)}

        inner = "pose." if "PoseStamped" in pose else "pose.pose."
        names = (f"{inner}position.", f"{inner}orientation.")
        if "Transform" in pose:
            names = ("transform.translation.", "transform.rotation.")
        add(topic, pose, p, lay(names[0], p.values) | lay(names[1], q), latency, pose_clock_ns)
        if truth:
            wrong = lay("pose.position.", p.values + 99.0) | lay("pose.orientation.", q)
            add("/ground_truth/pose", "geometry_msgs/msg/PoseStamped", p, wrong)
        if "gyro" in log.series:
            gyro, accel = log.series["gyro"], log.series["accel"]
            imu = lay("angular_velocity.", gyro.values) | lay("linear_acceleration.", accel.values)
            add("/imu/data_raw", "sensor_msgs/msg/Imu", gyro, imu)
        if "rotor_command" in log.series:
            command = log.series["rotor_command"]
            speeds = {"speed": command.values}
            add("/rotor_command", "tombo_msgs/msg/RotorSpeeds", command, speeds)
        if "voltage" in log.series:
            volts = log.series["voltage"]
            battery = {"voltage": volts.values[:, 0], "current": -8.0}
            add("/battery", "sensor_msgs/msg/BatteryState", volts, battery)
        sink.write_columns(*parts)


class ULogWriter:
    """Writes the ULog format byte by byte (PX4 user guide, "ULog File Format")."""

    def __init__(self):
        self.definitions = b""
        self.subscriptions = b""
        self.data = []
        self.ids = 0

    def message(self, kind, payload):
        return struct.pack("<HB", len(payload), ord(kind)) + payload

    def topic(self, name, fields, columns, stamps_us, multi_id=0):
        """`fields`: as "float[3] gyro_rad"; `columns`: (N, ...) arrays in their order."""
        if f"{name}:".encode() not in self.definitions:
            text = f"{name}:uint64_t timestamp;" + "".join(f"{f};" for f in fields)
            self.definitions += self.message("F", text.encode())
        head = struct.pack("<BH", multi_id, self.ids)
        self.subscriptions += self.message("A", head + name.encode())
        kinds = {"float": "f", "uint64_t": "Q", "int32_t": "i", "uint32_t": "I", "uint8_t": "B"}
        for i, stamp in enumerate(stamps_us):
            row = struct.pack("<HQ", self.ids, int(stamp))
            for field, column in zip(fields, columns, strict=True):
                code = kinds[field.split(" ")[0].split("[")[0]]
                values = np.ravel(np.asarray(column[i]))
                values = values.astype(float) if code == "f" else [int(v) for v in values]
                row += struct.pack(f"<{len(values)}{code}", *values)
            self.data.append((int(stamp), self.message("D", row)))
        self.ids += 1

    def content(self):
        header = b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
        flags = self.message("B", bytes(40))
        rows = b"".join(row for _, row in sorted(self.data, key=lambda item: item[0]))
        return header + flags + self.definitions + self.subscriptions + rows


def microseconds(t):
    return np.round((t + 2.0) * 1e6).astype(np.int64)


def px4_poses(log):
    """Places (N, 3) in NED and attitudes (N, 4) wxyz, NED from FRD."""
    place, turn = (log.series[name].values for name in ("position", "attitude"))
    return ned_from_enu(place), px4_quaternion(turn)


def write_ulog(path, log, mocap=True, estimate=False, age_us=20_000):
    """A PX4 log of a made flight: everything in NED and FRD, angles of poses as wxyz."""
    place, turn = px4_poses(log)
    out = ULogWriter()
    stamps = microseconds(log.series["position"].t)
    if mocap:
        out.topic(
            "vehicle_visual_odometry",
            ["uint64_t timestamp_sample", "float[3] position", "float[4] q"],
            [stamps, place, turn],
            stamps + age_us,
        )
    if estimate:
        out.topic("vehicle_local_position", ["float x", "float y", "float z"], place.T, stamps)
        out.topic("vehicle_attitude", ["float[4] q"], [turn], stamps)
    if "gyro" in log.series:
        gyro, accel = log.series["gyro"], log.series["accel"]
        flip = np.array([1.0, -1.0, -1.0])
        count = gyro.t.size
        columns = {
            "float[3] gyro_rad": gyro.values * flip,
            "uint32_t gyro_integral_dt": [5000] * count,
            "int32_t accelerometer_timestamp_relative": [-1000] * count,
            "float[3] accelerometer_m_s2": accel.values * flip,
            "uint32_t accelerometer_integral_dt": [5000] * count,
        }
        out.topic("sensor_combined", columns, columns.values(), microseconds(gyro.t))
        rpm = log.series["rotor_speed"].values * 30.0 / np.pi
        shuffled = rpm[:, [2, 0, 3, 1]]
        command = np.clip(log.series["rotor_command"].values / 800.0, 0.0, 1.0)
        control = np.column_stack([command, np.full((count, 8), np.nan)])
        out.topic("actuator_motors", ["uint64_t timestamp_sample", "float[12] control"],
                  [microseconds(gyro.t), control], microseconds(gyro.t) + 500)  # fmt: skip
        volts = log.series["voltage"]
        out.topic("battery_status", ["float voltage_v", "float current_a"],
                  [volts.values[:, 0], np.full(volts.t.size, 7.0)],
                  microseconds(volts.t))  # fmt: skip
        escs(out, shuffled, microseconds(gyro.t))
    path.write_bytes(out.content())
    return out


def escs(out, rpm, stamps):
    """esc_status: an array of another message, as PX4 nests it."""
    nested = "esc_report:uint64_t timestamp;int32_t esc_rpm;uint8_t actuator_function;"
    out.definitions += out.message("F", nested.encode())
    text = "esc_status:uint64_t timestamp;esc_report[4] esc;"
    out.definitions += out.message("F", text.encode())
    out.subscriptions += out.message("A", struct.pack("<BH", 0, out.ids) + b"esc_status")
    for i, stamp in enumerate(stamps):
        row = struct.pack("<HQ", out.ids, int(stamp))
        for motor, speed in zip((2, 0, 3, 1), rpm[i], strict=True):
            row += struct.pack("<QiB", int(stamp), round(speed), 101 + motor)
        out.data.append((int(stamp), out.message("D", row)))
    out.ids += 1

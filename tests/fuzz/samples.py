"""Small whole files of every kind that the suite reads: what the fuzzer damages."""

from __future__ import annotations

import gzip
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zstandard

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "tombo_ws" / "src"
sys.path.insert(0, str(SRC / "tombo_logs" / "test" / "readers"))  # the writer of PX4 logs

import log_writers  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402
from rosbags.rosbag1 import Writer as Ros1Writer  # noqa: E402
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Ros2Writer  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402
from rosbags.typesys.store import Typestore  # noqa: E402

from tombo_bag.flight import Flight, Series  # noqa: E402
from tombo_bag.formats.mcap_sink import Columns, McapSink  # noqa: E402
from tombo_bag.recording import Recording  # noqa: E402
from tombo_bag.topics import IMU, MOCAP_POSE, TOPICS  # noqa: E402
from tombo_benchmarks.diagnosis.log_recording import record_log  # noqa: E402
from tombo_collision.network import network_text  # noqa: E402
from tombo_collision.steering import ACTIONS, HIGH  # noqa: E402

FLIGHT = ROOT / "tests" / "bags" / "paper_collision_0.mcap"
_RECEIVED_US = 1_700_000_000_000_000
_KEPT = 400
"""Messages of each topic."""


@dataclass(frozen=True)
class Sample:
    """A file, and what reads it.

    Attributes:
        name: unique; what the fuzzer prints.
        path: the whole file.
        reader: one of `READERS`.
        form: how it can be damaged within: `text`, `mcap`, `sqlite`, `gzip` or `bytes`.
    """

    name: str
    path: Path
    reader: str
    form: str = "bytes"


def make_samples(folder: Path) -> list[Sample]:
    """Write all samples into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    log = _log()
    return [*_recordings(folder, log), *_logs(folder, log), *_texts(folder)]


def _log() -> Flight:
    """A second in the air, of a vehicle that sways."""
    t = np.arange(0.0, 1.0, 0.01)
    sway = 0.1 * np.sin(6.0 * t)
    still = np.zeros_like(t)
    turn = np.column_stack([np.sin(sway / 2), still, still, np.cos(sway / 2)])
    lean = np.column_stack([still, -9.81 * np.sin(sway), 9.81 * np.cos(sway)])
    speeds = np.full((t.size, 4), 400.0) + sway[:, None]
    values = {
        "position": np.column_stack([sway, still, still + 1.0]),
        "attitude": turn,
        "gyro": np.column_stack([0.6 * np.cos(6.0 * t), still, still]),
        "accel": lean,
        "rotor_speed": speeds,
        "rotor_command": speeds,
        "voltage": np.full((t.size, 1), 16.0),
    }
    return Flight.measured("made", "made", {key: Series(t, v) for key, v in values.items()})


def _recordings(folder: Path, log: Flight) -> list[Sample]:
    found = []
    for compression in ("zstd", "lz4", "none"):
        path = folder / f"flight_{compression}.mcap"
        _flight(path, compression)
        found.append(Sample(f"mcap_{compression}", path, "recording", "mcap"))
    path = folder / "log.mcap"
    record_log(log, path)
    found.append(Sample("mcap_log", path, "recording", "mcap"))
    packed = folder / "packed.mcap.zstd"
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    found.append(Sample("mcap_packed", packed, "recording"))
    for mode in (CompressionMode.NONE, CompressionMode.MESSAGE):
        db3 = _rosbag2(folder / f"rosbag2_{mode.name}", path, mode)
        found.append(Sample(f"db3_{mode.name.lower()}", db3, "recording", "sqlite"))
    for how in (None, Ros1Writer.CompressionFormat.BZ2, Ros1Writer.CompressionFormat.LZ4):
        name = "none" if how is None else how.name.lower()
        bag = folder / f"flight_{name}.bag"
        _ros1(bag, path, how)
        found.append(Sample(f"bag_{name}", bag, "recording"))
    described = folder / "rosbag2_NONE" / "metadata.yaml"
    found.append(Sample("metadata", described, "folder", "text"))
    return found


def _flight(target: Path, compression: str) -> None:
    """The first messages of a recorded flight, on all of the suite's topics in it."""
    with Recording(FLIGHT) as recording, McapSink(target, compression=compression) as sink:
        for name, values in recording.metadata.items():
            sink.add_metadata(name, values)
        parts = []
        for topic in recording.topics:
            raw = recording.messages(topic)
            channel = sink.add_channel(topic, TOPICS[topic].typename, TOPICS[topic].qos)
            parts.append(Columns(channel, raw.log_times_ns[:_KEPT], raw.messages[:_KEPT]))
        sink.write_columns(*parts)


def _rosbag2(folder: Path, source: Path, mode: CompressionMode) -> Path:
    writer = Ros2Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3)
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with Recording(source) as recording, writer:
        for topic in (MOCAP_POSE, IMU):
            raw = recording.messages(topic.name)
            connection = writer.add_connection(topic.name, topic.typename, typestore=store)
            for time, message in zip(raw.log_times_ns.tolist(), raw.messages, strict=True):
                writer.write(connection, time, message)
    return next(folder.glob("*.db3*"))


def _ros1(path: Path, source: Path, how: Ros1Writer.CompressionFormat | None) -> None:
    writer, store = Ros1Writer(path), get_typestore(Stores.ROS1_NOETIC)
    modern = get_typestore(Stores.ROS2_JAZZY)
    if how is not None:
        writer.set_compression(how)
    with Recording(source) as recording, writer:
        raw = recording.messages(MOCAP_POSE.name)
        typename = MOCAP_POSE.typename
        connection = writer.add_connection(MOCAP_POSE.name, typename, typestore=store)
        for time, message in zip(raw.log_times_ns.tolist(), raw.messages, strict=True):
            pose = modern.deserialize_cdr(message, typename)
            old = _ros1_pose(store, pose)
            writer.write(connection, time, store.serialize_ros1(old, typename))


def _ros1_pose(store: Typestore, pose: object) -> object:
    types, given = store.types, pose
    header = given.header  # type: ignore[attr-defined]
    stamp = types["builtin_interfaces/msg/Time"](header.stamp.sec, header.stamp.nanosec)
    old = types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="map")
    return types[MOCAP_POSE.typename](header=old, pose=given.pose)  # type: ignore[attr-defined]


def _logs(folder: Path, log: Flight) -> list[Sample]:
    ulog = folder / "flight.ulg"
    log_writers.write_ulog(ulog, log, estimate=True)
    tlog = folder / "flight.tlog"
    tlog.write_bytes(_tlog(log))
    table = folder / "flight.csv"
    table.write_text(log_writers.table_text(log))
    packed = folder / "flight.csv.gz"
    packed.write_bytes(gzip.compress(table.read_bytes()))
    speed = np.arange(0.0, 420.0, 10.0)
    rows = [f"{w:.1f},{1.1e-5 * w * w:.5f},{1.5e-7 * w * w:.6f}" for w in speed]
    stand = folder / "stand.csv"
    stand.write_text("speed_rad_s,thrust_N,torque_Nm\n" + "\n".join(rows) + "\n")
    trace = folder / "trace.csv"
    trace.write_text(
        "time_s,thrust_N\n" + "".join(f"{0.01 * i},{1.0 - 0.1 * i}\n" for i in range(30))
    )
    return [
        Sample("ulog", ulog, "log"),
        Sample("tlog", tlog, "log"),
        Sample("csv", table, "log", "text"),
        Sample("csv_gz", packed, "log", "gzip"),
        Sample("stand", stand, "stand", "text"),
        Sample("trace", trace, "trace", "text"),
    ]


def _tlog(log: Flight) -> bytes:
    coder, out = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), b""
    poses, imu = log.series["position"], log.series["gyro"]
    for i, t in enumerate(poses.t):
        us, x, turn = round(1e6 * t), poses.values[i], log.series["attitude"].values[i]
        accel, gyro = log.series["accel"].values[i], imu.values[i]
        for message in (
            coder.att_pos_mocap_encode(us, [turn[3], *turn[:3]], *x),
            coder.highres_imu_encode(us, *accel, *gyro, 0, 0, 0, 0, 0, 0, 0, 63),
        ):
            out += (_RECEIVED_US + us).to_bytes(8, "big") + message.pack(coder)
    return out


_VEHICLE = SRC / "tombo_flight" / "tombo_flight" / "vehicles" / "px4_x500.yaml"
_SCENARIO = SRC / "tombo_flight" / "tombo_flight" / "scenarios" / "survey.yaml"
_MAPPING = SRC / "tombo_logs" / "tombo_logs" / "readers" / "mappings" / "generic.yaml"
_STAND = SRC / "tombo_diagnosis" / "tombo_diagnosis" / "stand" / "mappings" / "crazyflie_rig.yaml"
_LIBRARY = SRC / "tombo_dynamics" / "tombo_dynamics" / "propeller" / "data"
_MODEL = """tombo_model: 1
effects:
  linear_rotor_drag:
    confidence: 0.98
    parameters:
      d_xy: {unit: N s/m, nominal: 0.0, value: 0.45, low: 0.44, high: 0.46}
    covariance: [[0.0001]]
origin: {tool: tombo, date: 2026-01-01, verdict: model error, confidence: 0.9, flights: []}
gain: []
notes: [one]
...
"""
_STAND_MODEL = """tombo_stand_model: 1
effects:
  air_density:
    confidence: 0.9
    parameters:
      error: {value: 1.01, unit: '1'}
"""


def _texts(folder: Path) -> list[Sample]:
    found = []
    for name, source in (
        *(("vehicle", _VEHICLE), ("scenario", _SCENARIO)),
        *(("mapping", _MAPPING), ("stand_mapping", _STAND)),
    ):
        path = folder / f"{name}.yaml"
        shutil.copyfile(source, path)
        found.append(Sample(name, path, name, "text"))
    for name, text in (("model", _MODEL), ("stand_model", _STAND_MODEL)):
        path = folder / f"{name}.yaml"
        path.write_text(text)
        found.append(Sample(name, path, name, "text"))
    path = folder / "policy.json"
    path.write_text(network_text([np.full((ACTIONS, HIGH.size + 1), 0.25)]))
    found.append(Sample("policy", path, "policy", "text"))
    for name in ("blades", "materials", "configurations", "measurements"):
        path = folder / "library" / f"{name}.yaml"
        path.parent.mkdir(exist_ok=True)
        shutil.copyfile(_LIBRARY / path.name, path)
        found.append(Sample(f"library_{name}", path, "library", "text"))
    return found

"""Any recorded run: kinds of files, folders, damage, names."""

import shutil
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from tombo_bag.columnar_cdr import encode
from tombo_bag.formats import unpacking
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_bag.schemas import schema_text
from tombo_dynamics.errors import InputError

TYPE = "geometry_msgs/msg/PoseStamped"
SECOND = 1_000_000_000
TIMES = [5 * SECOND + i * 33_000_000 for i in range(40)]
ROS1 = get_typestore(Stores.ROS1_NOETIC)
UNPACKED = CompressionMode.NONE
ROS2 = get_typestore(Stores.ROS2_JAZZY)


def values(i: int) -> dict:
    return {
        "header": {"stamp": {"sec": 5, "nanosec": i * 1000}, "frame_id": "map"},
        "pose": {"position": {"x": 0.5 * i, "y": -1.0, "z": 2.0}, "orientation": {"w": 1.0}},
    }


def messages() -> list[bytes]:
    return [encode(TYPE, values(i)) for i in range(len(TIMES))]


def write_mcap(path: Path, rows: slice = slice(None), topic: str = "/mocap/pose") -> Path:
    with McapSink(path, chunk_span_ns=200_000_000) as sink:
        sink.add_metadata("tombo_flight", {"scenario": "{}"})
        channel = sink.add_channel(topic, TYPE)
        sink.write_columns(Columns(channel, np.array(TIMES[rows]), messages()[rows]))
    return path


def write_rosbag2(folder: Path, plugin: StoragePlugin, mode: CompressionMode) -> Path:
    writer = Ros2Writer(folder, version=9, storage_plugin=plugin)
    if mode != UNPACKED:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/mocap/pose", TYPE, typestore=ROS2)
        for time, message in zip(TIMES, messages(), strict=True):
            writer.write(connection, time, message)
    return folder


def write_ros1(
    path: Path,
    compression: Ros1Writer.CompressionFormat | None = None,
    times: Sequence[int] = TIMES,
) -> Path:
    t = ROS1.types
    writer = Ros1Writer(path)
    writer.chunk_threshold = 20_000
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connection = writer.add_connection("/mocap/pose", TYPE, typestore=ROS1)
        unit = t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        for i, time in enumerate(times):
            stamp = t["builtin_interfaces/msg/Time"](sec=5, nanosec=i * 1000)
            header = t["std_msgs/msg/Header"](seq=i, stamp=stamp, frame_id="map")
            point = t["geometry_msgs/msg/Point"](x=0.5 * i, y=-1.0, z=2.0)
            pose = t["geometry_msgs/msg/Pose"](position=point, orientation=unit)
            message = t[TYPE](header=header, pose=pose)
            writer.write(connection, time, ROS1.serialize_ros1(message, TYPE))
    return path


def check_whole(path: Path, damage: int = 0) -> Recording:
    with Recording(path) as recording:
        table = recording.columns("/mocap/pose")
        stream = recording.topics["/mocap/pose"]
        assert table["log_time_ns"].tolist() == TIMES
        assert table["stamp_ns"].tolist() == [5 * SECOND + i * 1000 for i in range(40)]
        assert table["pose.position.x"].tolist() == [0.5 * i for i in range(40)]
        assert set(table["header.frame_id"].tolist()) == {"map"}
        assert (stream.typename, stream.count) == (TYPE, 40)
        assert (stream.first_ns, stream.last_ns) == (TIMES[0], TIMES[-1])
        assert recording.messages("/mocap/pose").messages == messages()
        assert len(recording.damage) == damage, recording.damage
    return recording


def test_one_mcap_file_with_its_metadata(tmp_path):
    recording = check_whole(write_mcap(tmp_path / "run.mcap"))
    assert recording.metadata["tombo_flight"] == {"scenario": "{}"}


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        (StoragePlugin.SQLITE3, UNPACKED),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, UNPACKED),
    ],
)
def test_a_rosbag2_folder(tmp_path, plugin, mode):
    check_whole(write_rosbag2(tmp_path / "bag", plugin, mode))


def test_an_mcap_file_compressed_as_a_whole(tmp_path):
    path = write_mcap(tmp_path / "run.mcap")
    packed = tmp_path / "bag" / "run.mcap.zstd"
    packed.parent.mkdir()
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    check_whole(packed)
    check_whole(packed.parent)


def test_a_lone_sqlite_file(tmp_path):
    folder = write_rosbag2(tmp_path / "bag", StoragePlugin.SQLITE3, UNPACKED)
    (file,) = folder.glob("*.db3")
    check_whole(file)


def test_an_sqlite_file_of_a_killed_recorder_with_its_write_ahead_log(tmp_path):
    folder = write_rosbag2(tmp_path / "bag", StoragePlugin.SQLITE3, UNPACKED)
    (file,) = folder.glob("*.db3")
    live = sqlite3.connect(file)
    live.execute("PRAGMA journal_mode=WAL")
    live.execute("PRAGMA wal_autocheckpoint=0")
    rows = live.execute("SELECT topic_id, data FROM messages LIMIT 1").fetchone()
    live.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
                 (rows[0], TIMES[-1] + 1, rows[1]))  # fmt: skip
    live.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    for part in file.parent.glob("*.db3*"):
        shutil.copy(part, killed / part.name)
    live.close()
    with Recording(killed) as recording:
        assert len(recording.messages("/mocap/pose").messages) == 41


def test_a_folder_without_metadata_is_read_whole_in_order_of_log_time(tmp_path):
    write_mcap(tmp_path / "run_0.mcap", slice(20, None))
    write_mcap(tmp_path / "run_1.mcap", slice(0, 20))
    (tmp_path / "notes.txt").write_text("no recording")
    check_whole(tmp_path)


@pytest.mark.parametrize("named", ["a_0.mcap.zstd", "as_it_was_called.mcap", "a_2.mcap"])
def test_a_file_that_metadata_names_and_that_is_missing_is_said(tmp_path, named):
    """It was unpacked, renamed or lost: the recordings that are there are read."""
    write_mcap(tmp_path / "a_0.mcap", slice(0, 20))
    write_mcap(tmp_path / "a_1.mcap", slice(20, None))
    (tmp_path / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  relative_file_paths: [bag/{named}, a_1.mcap]\n"
    )
    recording = check_whole(tmp_path, damage=1)
    assert f"{named}, which metadata.yaml names, is missing" in recording.damage[0]


def test_a_folder_of_ros_1_bags_is_one_recording(tmp_path):
    write_ros1(tmp_path / "run_0.bag")
    check_whole(tmp_path)
    write_ros1(tmp_path / "run_1.bag", times=[time + 10 * SECOND for time in TIMES])
    with Recording(tmp_path) as recording:
        assert recording.topics["/mocap/pose"].count == 2 * len(TIMES)


def test_metadata_that_is_garbage_is_said_and_passed_over(tmp_path):
    write_mcap(tmp_path / "run.mcap")
    (tmp_path / "metadata.yaml").write_text("{]")
    recording = check_whole(tmp_path, damage=1)
    assert "metadata.yaml can't be read" in recording.damage[0]


@pytest.mark.parametrize(
    "compression", [None, Ros1Writer.CompressionFormat.BZ2, Ros1Writer.CompressionFormat.LZ4]
)
def test_a_ros_1_bag(tmp_path, compression):
    check_whole(write_ros1(tmp_path / "old.bag", compression))


def test_ros_1_messages_in_an_mcap_file(tmp_path):
    from rosbags.rosbag1 import Reader

    path = tmp_path / "converted.mcap"
    with path.open("wb") as file, Reader(write_ros1(tmp_path / "old.bag")) as bag:
        writer = Writer(file)
        writer.start("ros1")
        definition = bag.connections[0].msgdef.data.encode()
        schema = writer.register_schema("geometry_msgs/PoseStamped", "ros1msg", definition)
        channel = writer.register_channel("/mocap/pose", "ros1", schema)
        for _, time, message in bag.messages():
            writer.add_message(channel, time, message, time)
        writer.finish()
    check_whole(path)


def test_a_ros_1_bag_that_was_never_closed(tmp_path):
    data = write_ros1(tmp_path / "old.bag").read_bytes()
    position = data.index(b"index_pos=") + len(b"index_pos=")
    path = tmp_path / "unclosed.bag.active"
    path.write_bytes(data[:position] + bytes(8) + data[position + 8 :])
    assert "never closed" in check_whole(path, 1).damage[0]


def test_a_ros_1_chunk_that_is_corrupt_is_left_out(tmp_path):
    path = write_ros1(tmp_path / "old.bag", Ros1Writer.CompressionFormat.BZ2)
    data = bytearray(path.read_bytes())
    place = data.index(b"BZh")
    data[place + 40 : place + 60] = bytes(20)
    path.write_bytes(data)
    with Recording(path) as recording:
        assert len(recording.columns("/mocap/pose")["stamp_ns"]) == 0
        assert any("corrupt" in line for line in recording.damage)


def long_sqlite(folder: Path) -> Path:
    (file,) = write_rosbag2(folder, StoragePlugin.SQLITE3, UNPACKED).glob("*.db3")
    with closing(sqlite3.connect(file)) as grown:
        (number, data) = grown.execute("SELECT topic_id, data FROM messages LIMIT 1").fetchone()
        grown.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(number, TIMES[-1] + i, data) for i in range(1, 2000)],
        )
        grown.commit()
    return file


WHOLE = {
    "SQLite": long_sqlite,
    "ROS 1": lambda path: write_ros1(path, None, range(2000)),
    "ROS 1, bz2": lambda path: write_ros1(path, Ros1Writer.CompressionFormat.BZ2, range(2000)),
    "ROS 1, lz4": lambda path: write_ros1(path, Ros1Writer.CompressionFormat.LZ4, range(2000)),
}


@pytest.mark.parametrize("kind", WHOLE)
def test_of_a_recording_that_is_cut_at_ten_places_all_is_read_up_to_the_cut(tmp_path, kind):
    whole = WHOLE[kind](tmp_path / "whole")
    data, path = whole.read_bytes(), tmp_path / f"cut{whole.suffix}"
    with Recording(whole) as recording:
        every = recording.messages("/mocap/pose").log_times_ns.tolist()
    read = []
    for share in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99):
        path.write_bytes(data[: round(share * len(data))])
        with Recording(path) as recording:
            there = "/mocap/pose" in recording.topics
            times = recording.messages("/mocap/pose").log_times_ns.tolist() if there else []
            assert times == every[: len(times)]
            assert any("cut off" in line for line in recording.damage)
        read.append(len(times) / len(every))
    assert read == sorted(read) and read[5] > 0.2 and read[9] > 0.9, read


def test_a_cut_compressed_file_gives_what_was_unpacked(tmp_path):
    path = write_mcap(tmp_path / "run.mcap")
    noise = np.random.default_rng(1).bytes(300_000)  # does not compress: the cut falls in it
    packed = zstandard.compress(path.read_bytes() + noise)
    (tmp_path / "run.mcap.zstd").write_bytes(packed[: len(packed) // 2])
    path.unlink()
    with Recording(tmp_path / "run.mcap.zstd") as recording:
        assert len(recording.columns("/mocap/pose")["stamp_ns"]) == 40
        assert any("compressed file is cut off" in line for line in recording.damage)


def test_a_compressed_file_is_unpacked_up_to_the_limit(tmp_path, monkeypatch):
    path = write_mcap(tmp_path / "run.mcap")
    (tmp_path / "run.mcap.zstd").write_bytes(zstandard.compress(path.read_bytes() + bytes(10**7)))
    path.unlink()
    monkeypatch.setattr(unpacking, "largest_size", lambda: 10**6)
    with Recording(tmp_path / "run.mcap.zstd") as recording:
        assert len(recording.columns("/mocap/pose")["stamp_ns"]) == 40
        assert any("a quarter of the memory" in line for line in recording.damage)
    with pytest.raises(ValueError, match="holds more than 1000000 bytes"):
        unpacking.unpack("zstd", zstandard.compress(bytes(10**7)))


def test_messages_that_do_not_fit_their_type_are_left_out_and_counted(tmp_path):
    path = tmp_path / "run.mcap"
    with McapSink(path) as sink:
        channel = sink.add_channel("/mocap/pose", TYPE)
        bad = [messages()[0], messages()[1][:20], b"", messages()[3]]
        sink.write_columns(Columns(channel, np.array(TIMES[:4]), bad))
    with Recording(path) as recording:
        assert recording.columns("/mocap/pose")["pose.position.x"].tolist() == [0.0, 1.5]
        assert recording.columns("/mocap/pose")["log_time_ns"].tolist() == [TIMES[0], TIMES[3]]
        assert "2 of 4 messages" in recording.damage[0]


def test_a_topic_under_another_name_hides_the_one_that_has_it(tmp_path):
    path = tmp_path / "run.mcap"
    with McapSink(path) as sink:
        for i, topic in enumerate(("/mocap/pose", "/lab/pose")):
            channel = sink.add_channel(topic, TYPE)
            sink.write_columns(Columns(channel, np.array(TIMES[i : i + 1]), messages()[i : i + 1]))
    with Recording(path, {"/lab/pose": "/mocap/pose"}) as recording:
        assert list(recording.topics) == ["/mocap/pose"]
        assert recording.columns("/mocap/pose")["pose.position.x"].tolist() == [0.5]


def test_names_that_can_not_be_are_refused(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", topic="/lab/pose")
    with pytest.raises(InputError, match=r"unknown topic.*did you mean '/lab/pose'"):
        Recording(path, {"/lab/poses": "/mocap/pose"})
    with Recording(path) as recording, pytest.raises(InputError, match="unknown topic"):
        recording.columns("/mocap/pose")


def test_another_clock_gives_the_log_times_of_columns(tmp_path):
    with Recording(write_mcap(tmp_path / "run.mcap")) as recording:
        recording.set_clock(np.array([TIMES[0], TIMES[10]]), np.array([100, 200]))
        times = recording.columns("/mocap/pose")["log_time_ns"]
        assert times[:10].tolist() == [100] * 10 and times[10:].tolist() == [200] * 30


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"time,x,y\n0,1,2\n", "starts with bytes 74 69 6d 65"),
        (b"#ROSBAG V1.2\n" + bytes(100), "ROS 1 bag of version 1.2"),
        (b"SQLite format 3\0" + bytes(200), "accepted: an SQLite file"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path, content, says):
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(InputError, match="accepted") as caught:
        Recording(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_folders_without_a_recording_and_missing_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="holds no recording"):
        Recording(tmp_path)
    with pytest.raises(InputError, match="can't read"):
        Recording(tmp_path / "none.mcap")
    (tmp_path / "a.mcap").write_bytes(b"")
    write_mcap(tmp_path / "b.mcap")
    recording = check_whole(tmp_path, damage=1)
    assert any("a.mcap' is empty" in line for line in recording.damage)


def test_a_column_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "")
        text = schema_text(TYPE).replace("float64 x\n", "", 1)
        schema = writer.register_schema(TYPE, "ros2msg", text.encode())
        channel = writer.register_channel("/x", "cdr", schema)
        writer.add_message(channel, 5, bytes([0, 1, 0, 0]) + bytes(200), 5)
        writer.finish()
    with Recording(path) as recording:
        table = recording.columns("/x")
        assert "pose.position.x" not in table
        with pytest.raises(InputError, match=r"column of /x 'pose\.position\.x'.*accepted: .*"):
            table["pose.position.x"]

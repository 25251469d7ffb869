"""Recordings of others: too large, of wrong types, with wrong stamps; read in part or refused."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
import zstandard
from mcap.writer import Writer

from tombo_bag.columnar_cdr import encode
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.formats.unpacking import unpacking_up_to
from tombo_bag.recording import Recording
from tombo_bag.schemas import schema_text
from tombo_dynamics.errors import InputError

POSE = "geometry_msgs/msg/PoseStamped"
TIMES = np.arange(1, 41) * 50_000_000
MESSAGES = [encode(POSE, {"pose": {"position": {"x": float(i)}}}) for i in range(40)]


def good_mcap(path, **more):
    with McapSink(path, **more) as sink:
        sink.write_columns(Columns(sink.add_channel("/pose", POSE), TIMES, MESSAGES))
    return path


@pytest.mark.parametrize("how", ["chunks", "file"])
def test_what_unpacks_to_more_than_a_hundred_times_its_size_is_refused(tmp_path, how):
    messages = [encode("std_msgs/msg/String", {"data": "x" * 2_000_000})] * 40
    path = tmp_path / "large.mcap"
    with McapSink(path, compression="zstd" if how == "chunks" else "none") as sink:
        channel = sink.add_channel("/word", "std_msgs/msg/String")
        sink.write_columns(Columns(channel, TIMES * 20, messages))
    if how == "file":
        path.write_bytes(zstandard.compress(path.read_bytes()))
    with pytest.raises(InputError, match=r"unpacks to too much; .*--unpack-limit"):
        Recording(path)
    with unpacking_up_to(10**8), Recording(path) as recording:
        assert len(recording.messages("/word").messages) == 40


def test_the_limit_can_be_given(tmp_path):
    path = good_mcap(tmp_path / "good.mcap")
    with unpacking_up_to(1000), pytest.raises(InputError, match="as --unpack-limit says"):
        Recording(path)
    with unpacking_up_to(10**6), Recording(path) as recording:
        assert recording.topics["/pose"].count == 40


@pytest.mark.parametrize("late", [2**62, 2**63, 2**64 - 1])
def test_a_log_time_that_no_clock_shows_is_damage(tmp_path, late):
    path = tmp_path / "late.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "")
        schema = writer.register_schema(POSE, "ros2msg", schema_text(POSE).encode())
        channel = writer.register_channel("/pose", "cdr", schema)
        for moment in (5, late, 7):
            writer.add_message(channel, moment, MESSAGES[0], late)
        writer.finish()
    with Recording(path) as recording:
        table = recording.columns("/pose")
        assert table["log_time_ns"].tolist() == [5, 7]
        assert recording.topics["/pose"].last_ns == 7
        assert any("after the year 2116" in line for line in recording.damage)


def schema_mcap(path, typename, text, message):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "")
        schema = writer.register_schema(typename, "ros2msg", text.encode())
        channel = writer.register_channel("/x", "cdr", schema)
        writer.add_message(channel, 5, message, 5)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("geometry_msgs/Pose pose", "float64 pose", "field 'pose' in this file"),
        ("float64 x", "string x", "field 'x' in this file"),
        ("float64 x", "float64[3] x", "field 'x' in this file"),
    ],
)
def test_a_standard_type_that_is_defined_otherwise_is_refused(tmp_path, old, new, why):
    text = schema_text(POSE).replace(old, new)
    assert text != schema_text(POSE)
    path = schema_mcap(tmp_path / "x.mcap", POSE, text, MESSAGES[0])
    with Recording(path) as recording, pytest.raises(InputError, match=why):
        recording.columns("/x")


def test_a_column_that_is_not_there_is_named(tmp_path):
    text = schema_text(POSE).replace("float64 x\n", "", 1)
    path = schema_mcap(tmp_path / "x.mcap", POSE, text, bytes([0, 1, 0, 0]) + bytes(200))
    with Recording(path) as recording:
        table = recording.columns("/x")
        assert "pose.position.x" not in table
        with pytest.raises(InputError, match=r"column of /x 'pose\.position\.x'.*accepted: .*"):
            table["pose.position.x"]


TABLES = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)",
    f"INSERT INTO topics VALUES (1, '/pose', '{POSE}', 'cdr')",
)
COLUMNS = "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB"


def database(path, *statements):
    with closing(sqlite3.connect(path)) as file:
        for statement in statements:
            file.execute(statement)
        file.commit()
    return path


def messages_table(path):
    with closing(
        sqlite3.connect(database(path, *TABLES, f"CREATE TABLE messages({COLUMNS})"))
    ) as file:
        rows = [(int(t), m) for t, m in zip(TIMES, MESSAGES, strict=True)]
        insert = "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)"
        file.executemany(insert, rows)
        file.commit()
    return path


@pytest.mark.parametrize("change", ["timestamp = 'soon'", "timestamp = -5", "data = 'text'"])
def test_rows_of_other_types_are_left_out(tmp_path, change):
    path = messages_table(tmp_path / "x.db3")
    with closing(sqlite3.connect(path)) as file:
        file.execute(f"UPDATE messages SET {change} WHERE id % 4 = 0")
        file.commit()
    with Recording(path) as recording:
        assert recording.topics["/pose"].count == 30
        assert recording.columns("/pose")["log_time_ns"].size == 30
        assert any("10 rows of topic /pose are no messages" in line for line in recording.damage)

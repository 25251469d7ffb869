"""Recordings made to stop their reader: each is read without what is damaged, or refused."""

import bz2
import resource
import sqlite3
import struct
import time
from contextlib import closing

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from tombo_bag.columnar_cdr import encode
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.formats.unpacking import Allowance, unbz2, ungzip, unlz4, unpacking_up_to, unzstd
from tombo_bag.recording import Recording
from tombo_bag.schemas import extended_store, parse_schema, schema_text
from tombo_dynamics.errors import InputError

POSE = "geometry_msgs/msg/PoseStamped"
TIMES = np.arange(1, 41) * 50_000_000
MESSAGES = [encode(POSE, {"pose": {"position": {"x": float(i)}}}) for i in range(40)]
BOMB = 100_000_000


@pytest.fixture(autouse=True)
def bounded():
    """No test may take a gigabyte or 10 s."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    with open("/proc/self/statm") as statm:
        used = int(statm.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 1_000_000_000, before[1]))
    began = time.process_time()
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)
    assert time.process_time() - began < 10.0


def record(code, body):
    return bytes([code]) + len(body).to_bytes(8, "little") + body


def chunk(raw, packed, how, stated=None):
    size = len(raw) if stated is None else stated
    head = struct.pack("<QQQI", 1, 2, size, 0) + len(how).to_bytes(4, "little") + how.encode()
    return record(6, head + len(packed).to_bytes(8, "little") + packed)


def good_mcap(path, **more):
    with McapSink(path, **more) as sink:
        sink.write_columns(Columns(sink.add_channel("/pose", POSE), TIMES, MESSAGES))
    return path


def with_chunk(path, bomb):
    """A good recording with another chunk before its own."""
    raw = good_mcap(path).read_bytes()
    head = 8 + 9 + int.from_bytes(raw[9:17], "little")  # magic and header
    path.write_bytes(raw[:head] + bomb + raw[head:])
    return path


def zeros_of_zstd(size):
    return zstandard.ZstdCompressor(level=19, write_content_size=False).compress(bytes(size))


@pytest.mark.parametrize("stated", [BOMB, 1000, 2**63, 2**64 - 1])
@pytest.mark.parametrize("how", ["zstd", "lz4"])
@pytest.mark.slow
def test_a_chunk_that_unpacks_to_gigabytes_is_damage(tmp_path, how, stated):
    packed = zeros_of_zstd(BOMB) if how == "zstd" else lz4.frame.compress(bytes(BOMB))
    path = with_chunk(tmp_path / "bomb.mcap", chunk(b"", packed, how, stated))
    with Recording(path) as recording:
        assert recording.columns("/pose")["pose.position.x"].tolist() == list(range(40))
        assert any("corrupt" in line for line in recording.damage)


def test_many_chunks_of_a_plausible_size_are_too_much_together(tmp_path):
    packed = zeros_of_zstd(30_000_000)
    path = with_chunk(tmp_path / "bomb.mcap", 300 * chunk(b"", packed, "zstd", 30_000_000))
    with pytest.raises(InputError, match=r"unpacks to too much; .*--unpack-limit"):
        Recording(path)


def test_the_limit_can_be_given(tmp_path):
    path = good_mcap(tmp_path / "good.mcap")
    with unpacking_up_to(1000), pytest.raises(InputError, match="as --unpack-limit says"):
        Recording(path)
    with unpacking_up_to(10**6), Recording(path) as recording:
        assert recording.topics["/pose"].count == 40


@pytest.mark.slow
def test_a_packed_file_that_unpacks_to_gigabytes_is_refused(tmp_path):
    path = tmp_path / "bomb.mcap.zstd"
    path.write_bytes(zeros_of_zstd(BOMB))
    with pytest.raises(InputError, match="unpacks to too much"):
        Recording(path)
    path.write_bytes(
        zstandard.compress(zstandard.compress(good_mcap(tmp_path / "a").read_bytes()))
    )
    with pytest.raises(InputError, match="starts with bytes"):  # packed twice, and more often
        Recording(path)


def test_unpackers_end_where_the_file_said(tmp_path):
    raw = np.random.default_rng(0).normal(size=50_000).tobytes()
    for pack, unpack in (
        (zstandard.compress, unzstd),
        (lz4.frame.compress, unlz4),
        (bz2.compress, unbz2),
    ):
        packed = pack(raw)
        assert unpack(packed, len(raw)) == raw
        with pytest.raises(ValueError, match="bytes"):
            unpack(packed, len(raw) - 1)
        with pytest.raises(ValueError, match=r".+"):
            unpack(b"\x28\xb5\x2f\xfdnothing", 10)


@pytest.mark.slow
def test_members_of_gzip_count_together(tmp_path):
    import gzip

    member = gzip.compress(bytes(20_000_000))
    with pytest.raises(InputError, match="unpacks to too much"):
        ungzip(member * 40, Allowance(tmp_path / "x.csv.gz", 100_000_000))
    text = b"".join(gzip.compress(b"1,2\n" * n) for n in (1, 1000, 100_000))
    assert ungzip(text, Allowance(tmp_path, 10**6)) == (b"1,2\n" * 101_001, "")


def ros1_record(fields, body):
    header = b"".join((len(f) + 4 - 4).to_bytes(4, "little") + f for f in fields)
    return len(header).to_bytes(4, "little") + header + len(body).to_bytes(4, "little") + body


@pytest.mark.slow
@pytest.mark.parametrize("stated", [BOMB, 2**32 - 1, 1000])
@pytest.mark.parametrize("how", [b"bz2", b"lz4"])
def test_a_chunk_of_a_ros_1_bag_that_unpacks_to_gigabytes_is_damage(tmp_path, how, stated):
    packed = bz2.compress(bytes(BOMB)) if how == b"bz2" else lz4.frame.compress(bytes(BOMB))
    size = b"size=" + stated.to_bytes(4, "little")
    path = tmp_path / "bomb.bag"
    fields = [b"op=\x05", b"compression=" + how, size]
    path.write_bytes(b"#ROSBAG V2.0\n" + ros1_record(fields, packed))
    with Recording(path) as recording:
        assert any("corrupt" in line for line in recording.damage)


@pytest.mark.parametrize("field", [b"op=", b"op=\x02\x02", b"op=\x02", b"op=\x07", b"x"])
def test_a_record_of_a_ros_1_bag_without_its_fields_is_damage(tmp_path, field):
    path = tmp_path / "odd.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + ros1_record([field], b""))
    with Recording(path) as recording:
        assert not recording.topics


def test_an_index_that_gives_one_message_many_times_is_not_believed(tmp_path):
    path = tmp_path / "rows.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2", "")
        schema = writer.register_schema(POSE, "ros2msg", schema_text(POSE).encode())
        channel = writer.register_channel("/pose", "cdr", schema)
        writer.add_message(channel, 5, MESSAGES[0] + bytes(4_000_000), 5)
        writer.finish()
    raw = path.read_bytes()
    at = raw.index(record(7, bytes(22))[:9])
    row = raw[at + 15 : at + 31]
    many = record(7, struct.pack("<HI", channel, 16 * 2000) + row * 2000)
    path.write_bytes(raw[:at] + many + raw[at + 31 :])
    with Recording(path) as recording:
        assert len(recording.messages("/pose").messages) == 1


@pytest.mark.parametrize("offset", [2**63, 2**64 - 40, 2**62])
def test_an_offset_or_length_that_turns_negative_is_not_believed(tmp_path, offset):
    path = good_mcap(tmp_path / "x.mcap", compression="none")
    raw = path.read_bytes()
    at = raw.index(b"\x05" + (22 + len(MESSAGES[0])).to_bytes(8, "little"))
    path.write_bytes(raw[: at + 1] + offset.to_bytes(8, "little") + raw[at + 9 :])
    with Recording(path) as recording:
        assert len(recording.messages("/pose").messages) < 40
        assert recording.damage


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


SEPARATOR = "=" * 80
MANY = b"\x00\x01\x00\x00" + (4_000_000_000).to_bytes(4, "little") + bytes(100)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (f"C[] c\n{SEPARATOR}\nMSG: a/C\nuint8[0] x\n", "0 elements"),
        (f"C[] c\n{SEPARATOR}\nMSG: a/C\nuint8 x\n", "ends too early"),
        (f"C[4000000000] c\n{SEPARATOR}\nMSG: a/C\nuint8 x\n", "4000000000 elements"),
        ("A a\n", "contains itself"),
        (f"B b\n{SEPARATOR}\nMSG: a/B\nA[] a\n", "contains itself"),
        (f"C c\n{SEPARATOR}\nMSG: a/C\nuint8[" + "9" * 30 + "] x\n", "elements|can't be read"),
        ("float64[] header\n" * 20_000, "characters; accepted|can't be read"),
    ],
    ids=lambda value: value[:20],
)
def test_a_type_without_end_is_refused(tmp_path, text, why):
    path = schema_mcap(tmp_path / "x.mcap", "a/msg/A", text, MANY)
    with Recording(path) as recording, pytest.raises(InputError, match=why):
        recording.columns("/x")


def test_elements_without_bytes_are_refused_in_ros_1(tmp_path):
    text = f"C[] c\n{SEPARATOR}\nMSG: a/C\n# nothing\n"
    assert parse_schema("a/msg/A", text)  # in ROS 2 such a message takes a byte
    with pytest.raises(InputError, match="without a field"):
        extended_store("a/msg/A", text)
    with pytest.raises(InputError, match="without a field"):
        extended_store("a/msg/A", "std_msgs/Empty[] c\n")


@pytest.mark.slow
def test_a_sequence_of_many_messages_takes_time_in_proportion(tmp_path):
    text = f"C[] c\n{SEPARATOR}\nMSG: a/C\nuint8 x\nuint8 y\n"
    number = 10_000
    message = b"\x00\x01\x00\x00" + number.to_bytes(4, "little") + bytes(2 * number)
    with Recording(schema_mcap(tmp_path / "x.mcap", "a/msg/A", text, message)) as recording:
        assert len(recording.columns("/x")) > 2 * number
    message = b"\x00\x01\x00\x00" + (100 * number).to_bytes(4, "little") + bytes(200 * number)
    path = schema_mcap(tmp_path / "y.mcap", "a/msg/A", text, message)
    refused = pytest.raises(InputError, match="numbers that have a name each")
    with Recording(path) as recording, refused:
        recording.columns("/x")


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
ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT"


def endless(name, *columns):
    return f"CREATE VIEW {name} AS {ENDLESS} {', '.join(columns)} FROM c"


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


@pytest.mark.parametrize(
    "statements",
    [
        (*TABLES, endless("messages", "1 AS topic_id", "x AS timestamp", "x'00' AS data")),
        (
            f"CREATE TABLE messages({COLUMNS})",
            endless(
                "topics", "x AS id", "'a' AS name", "'b' AS type", "'cdr' AS serialization_format"
            ),
        ),
        (*TABLES, "CREATE TABLE messages(topic_id, timestamp, data AS (zeroblob(900000000)))"),
        (*TABLES, "CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)"),
    ],
)
def test_a_table_that_computes_its_rows_is_refused(tmp_path, statements):
    path = database(tmp_path / "x.db3", *statements)
    with pytest.raises(InputError, match=r"no such (table|column): .*rosbag2's tables"):
        Recording(path)


@pytest.mark.parametrize(
    "change",
    [
        "timestamp = 'soon'",
        "timestamp = 9e999",
        "timestamp = -9e999",
        "timestamp = -5",
        f"timestamp = {2**62}",
        "timestamp = NULL",
        "data = 9000000000",
        "data = 'text'",
        "data = NULL",
    ],
)
def test_rows_of_other_types_are_left_out(tmp_path, change):
    path = messages_table(tmp_path / "x.db3")
    with closing(sqlite3.connect(path)) as file:
        file.execute(f"UPDATE messages SET {change} WHERE id % 4 = 0")
        file.commit()
    with Recording(path) as recording:
        assert recording.topics["/pose"].count == 30
        assert recording.columns("/pose")["log_time_ns"].size == 30
        assert any("10 rows are no messages" in line for line in recording.damage)

"""Logs, tables and mappings of others: damaged, too large or of another kind."""

import gzip
import re

import numpy as np
import pytest
from log_writers import write_bag, write_ulog
from mcap.writer import Writer

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight import Flight, Series
from tombo_bag.formats.ulog_messages import whole_messages
from tombo_bag.recording import Recording
from tombo_bag.schemas import schema_text
from tombo_dynamics.errors import InputError
from tombo_logs.checks.pipeline import check_log
from tombo_logs.readers.csv_mapping import parse_mapping
from tombo_logs.readers.csv_table import open_table
from tombo_logs.readers.log_reader import read_log

SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"


@pytest.fixture
def log():
    t = np.arange(0.0, 1.0, 0.01)
    place = np.column_stack([np.sin(t), np.zeros_like(t), np.ones_like(t)])
    turn = np.column_stack([0.1 * t, 0.0 * t, 0.0 * t, np.sqrt(1.0 - 0.01 * t**2)])
    return Flight.measured(
        "made", "made", {"position": Series(t, place), "attitude": Series(t, turn)}
    )


def test_a_whole_ulog_is_left_as_it_is(tmp_path, log):
    write_ulog(tmp_path / "x.ulg", log)
    raw = (tmp_path / "x.ulg").read_bytes()
    same, found = whole_messages(raw)
    assert same is raw
    assert not found.damaged and not found.cut
    same, found = whole_messages(raw[:-3])
    assert same == raw[:-3]
    assert found.cut and not found.damaged


def test_a_damaged_ulog_is_read_before_and_behind_the_damage(tmp_path, log):
    path = tmp_path / "x.ulg"
    write_ulog(path, log)
    raw = path.read_bytes()
    middle = raw.index(b"D", len(raw) // 2) - 2  # between two messages, or all but
    path.write_bytes(raw[:middle] + b"\x00" * 700 + SYNC + raw[middle:])
    damaged = read_log(path, "x")
    assert any("damaged" in finding.message for finding in damaged.findings)
    assert 60 < damaged.series["position"].t.size <= 100


def test_a_parameter_of_a_ulog_may_be_a_text(tmp_path, log):
    writer = write_ulog(tmp_path / "x.ulg", log)
    for i in range(4):
        key = f"char[3] CA_ROTOR{i}_PX".encode()
        writer.definitions += writer.message("P", bytes([len(key)]) + key + b"abc")
    (tmp_path / "x.ulg").write_bytes(writer.content())
    assert read_log(tmp_path / "x.ulg", "x").series["position"].t.size == 100


@pytest.mark.slow
def test_a_packed_table_that_unpacks_to_gigabytes_is_refused(tmp_path):
    path = tmp_path / "x.csv.gz"
    path.write_bytes(gzip.compress(b"t,x\n" + bytes(200_000_000)))
    with pytest.raises(InputError, match="unpacks to too much"):
        open_table(path)


@pytest.mark.parametrize(
    "text",
    [
        "metadata: abc",
        "metadata: [1, 2]",
        "time: {column: t}\nchannels: {position: {columns: [x, y, z], unit: m, scale: 0x"
        + "f" * 64
        + "}}",
        "airframe: {name: a, mass: [1], arm_length: 1, rotor_radius: 1}",
        "channels: {position: {columns: {a: 1, b: 2, c: 3}, unit: m}}",
        "turn_deg: {a: 1, b: 2, c: 3}",
    ],
)
def test_a_mapping_with_values_of_another_kind_is_refused(text):
    with pytest.raises(InputError, match="mapping 'lab'"):
        parse_mapping(text, "lab")


def test_a_topic_that_lacks_a_column_is_refused_by_name(tmp_path, log):
    write_bag(tmp_path / "good.mcap", log)
    typename = "sensor_msgs/msg/Imu"
    text = re.sub(r"\S+ linear_acceleration\n", "", schema_text(typename), count=1)
    path = tmp_path / "x.mcap"
    with path.open("wb") as file, Recording(tmp_path / "good.mcap") as good:
        writer = Writer(file)
        writer.start("ros2", "")
        pose = "geometry_msgs/msg/PoseStamped"
        schema = writer.register_schema(pose, "ros2msg", schema_text(pose).encode())
        channel = writer.register_channel("/mocap/pose", "cdr", schema)
        for message in good.messages("/mocap/pose").messages:
            writer.add_message(channel, 5, message, 5)
        schema = writer.register_schema(typename, "ros2msg", text.encode())
        channel = writer.register_channel("/imu/data_raw", "cdr", schema)
        writer.add_message(channel, 5, encode(typename, {}), 5)
        writer.finish()
    with pytest.raises(InputError, match="'linear_acceleration'"):
        read_log(path, "x")


def test_stamps_that_reach_over_years_are_refused(log):
    position = log.series["position"]
    late = Series(np.append(position.t[:-1], 2e9), position.values)
    series = {
        **log.series,
        "position": late,
        "attitude": Series(late.t, log.series["attitude"].values),
    }
    with pytest.raises(InputError, match="stamps reach over"):
        check_log(Flight.measured("made", "made", series))

"""Recordings of others: too large, of wrong types, with wrong stamps; read in part or refused."""

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


@pytest.mark.parametrize("how", ["chunks", "file"])
def test_unpacking_beyond_the_limit_is_refused(tmp_path, how):
    messages = [encode("std_msgs/msg/String", {"data": "x" * 2_000_000})] * 40
    path = tmp_path / "large.mcap"
    with McapSink(path) as sink:
        channel = sink.add_channel("/word", "std_msgs/msg/String")
        sink.write_columns(Columns(channel, TIMES * 20, messages))
    if how == "file":
        path.write_bytes(zstandard.compress(path.read_bytes()))
    with unpacking_up_to(10**8), Recording(path) as recording:
        assert len(recording.messages("/word").messages) == 40
    with (
        unpacking_up_to(10**7),
        pytest.raises(InputError, match=r"unpacks to more than .*--unpack-limit"),
        Recording(path) as recording,
    ):
        recording.messages("/word")
    if how == "chunks":
        with unpacking_up_to(10**6), Recording(path) as recording:
            assert not recording.messages("/word").messages
            assert "--unpack-limit" in recording.damage[0]


def schema_mcap(path, typename, text, message):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "")
        schema = writer.register_schema(typename, "ros2msg", text.encode())
        channel = writer.register_channel("/x", "cdr", schema)
        writer.add_message(channel, 5, message, 5)
        writer.finish()
    return path


def test_a_column_that_is_not_there_is_named(tmp_path):
    text = schema_text(POSE).replace("float64 x\n", "", 1)
    path = schema_mcap(tmp_path / "x.mcap", POSE, text, bytes([0, 1, 0, 0]) + bytes(200))
    with Recording(path) as recording:
        table = recording.columns("/x")
        assert "pose.position.x" not in table
        with pytest.raises(InputError, match=r"column of /x 'pose\.position\.x'.*accepted: .*"):
            table["pose.position.x"]

import struct
from collections import Counter
from io import BytesIO

import numpy as np
import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, DataEnd, Message, MessageIndex, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader as Rosbag2Reader

from tombo_bag.columnar_cdr import encode, layout
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.formats.reader import Bag
from tombo_bag.qos import EVENT
from tombo_bag.recording import Recording
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS

POSE = "geometry_msgs/msg/PoseStamped"
STRING = "std_msgs/msg/String"
MS = 1_000_000


def poses(number, first=0.0):
    records = layout(POSE, {"header": {"frame_id": "map"}}).records(number)
    records["pose.position.x"] = first + np.arange(number)
    return records


def text(word):
    return encode(STRING, {"data": word})


def summary_of(path):
    with path.open("rb") as file:
        return make_reader(file, validate_crcs=True).get_summary()


def write_mixed(path):
    """3.5 s of two channels in bulk, one of them out of order, then few messages at a time."""
    times = np.arange(3500) * MS + 7
    late = np.arange(35) * 100 * MS + (np.arange(35) % 3) * 150 * MS
    with McapSink(path) as sink:
        pose = sink.add_channel("/pose", POSE)
        slow = sink.add_channel("/slow", POSE)
        word = sink.add_channel("/word", STRING, EVENT)
        sink.add_channel("/silent", STRING)
        sink.add_metadata("about", {"what": "a test"})
        sink.write_columns(
            Columns(pose, times, poses(3500)),
            Columns(slow, late, poses(35, 1e6), late + 5),
            Columns(word, np.array([2 * SECOND_NS]), [text("two")]),
        )
        for i in range(0, 40, 5):
            times = 4 * SECOND_NS + np.arange(i, i + 5) * 100 * MS
            sink.write_columns(Columns(word, times, [text(f"word {i + k}") for k in range(5)]))
    return 3500 + 35 + 1 + 40


@pytest.fixture
def mixed(tmp_path):
    path = tmp_path / "mixed.mcap"
    return path, write_mixed(path)


def test_library_reads_all_in_order_with_checksums(mixed):
    path, number = mixed
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        decoded = list(reader.iter_decoded_messages())
    times = [item.message.log_time for item in decoded]
    assert len(decoded) == number
    assert times == sorted(times)
    x = [item.decoded_message.pose.position.x for item in decoded if item.channel.topic == "/pose"]
    assert x == list(range(3500))


def test_quality_of_service_and_type_hash_stand_in_the_channels(mixed):
    path, _ = mixed
    with Rosbag2Reader(path) as reader:
        profiles = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert profiles["/word"].durability.name == "TRANSIENT_LOCAL"
    assert profiles["/pose"].durability.name == "VOLATILE"
    assert profiles["/pose"].reliability.name == "RELIABLE"
    assert profiles["/pose"].history.name == "KEEP_LAST"
    channels = summary_of(path).channels.values()
    assert all(c.metadata["topic_type_hash"].startswith("RIHS01_") for c in channels)


def test_statistics_and_summary_say_what_is_there(mixed):
    path, number = mixed
    with path.open("rb") as file:
        reader = make_reader(file)
        header, summary = reader.get_header(), reader.get_summary()
        counted = Counter(m.channel_id for _, _, m in reader.iter_messages())
        times = [m.log_time for _, _, m in reader.iter_messages()]
    assert header.profile == "ros2"
    statistics = summary.statistics
    assert statistics.message_count == number
    assert statistics.channel_message_counts == counted
    assert (statistics.message_start_time, statistics.message_end_time) == (min(times), max(times))
    assert statistics.chunk_count == len(summary.chunk_indexes)
    assert statistics.channel_count == 4 == len(summary.channels)
    assert statistics.schema_count == 2 == len(summary.schemas)
    assert statistics.metadata_count == 1 == len(summary.metadata_indexes)


def test_message_indexes_lead_to_the_messages(mixed):
    path, number = mixed
    content, found = path.read_bytes(), 0
    chunks = summary_of(path).chunk_indexes
    for chunk in chunks:
        place = chunk.chunk_start_offset
        record = Chunk.read(ReadDataStream(BytesIO(content[place + 9 :])))
        inside, _ = get_chunk_data_stream(record, validate_crc=True)
        data = inside.read(chunk.uncompressed_size)
        for channel, offset in chunk.message_index_offsets.items():
            assert content[offset] == Opcode.MESSAGE_INDEX
            index = MessageIndex.read(ReadDataStream(BytesIO(content[offset + 9 :])))
            assert index.channel_id == channel
            for time, at in index.records:
                opcode, length = struct.unpack_from("<BQ", data, at)
                message = Message.read(ReadDataStream(BytesIO(data[at + 9 :])), length)
                assert (opcode, message.channel_id) == (Opcode.MESSAGE, channel)
                assert message.log_time == time
                found += 1
    assert found == number


def test_a_slice_of_messages_keeps_its_texts(tmp_path):
    with McapSink(tmp_path / "a.mcap") as sink:
        channel = sink.add_channel("/pose", POSE)
        sink.write_columns(Columns(channel, np.arange(5) * MS, poses(15)[::3]))
    table = Recording(tmp_path / "a.mcap").columns("/pose")
    assert table["header.frame_id"].tolist() == ["map"] * 5
    assert table["pose.position.x"].tolist() == [0.0, 3.0, 6.0, 9.0, 12.0]


def test_an_empty_file_is_a_proper_file(tmp_path):
    with McapSink(tmp_path / "none.mcap"):
        pass
    with McapSink(tmp_path / "announced.mcap") as sink:
        channel = sink.add_channel("/pose", POSE)
        sink.write_columns(Columns(channel, np.zeros(0, int), poses(0)))
    for name in ("none", "announced"):
        path = tmp_path / f"{name}.mcap"
        with path.open("rb") as file:
            assert make_reader(file).get_summary().statistics.message_count == 0
            assert list(make_reader(file).iter_messages()) == []
        with AnyReader([path]) as reader:
            assert list(reader.messages()) == []
        assert Bag(path).damage == []
    records = [type(r) for r in StreamReader(str(tmp_path / "announced.mcap")).records]
    assert records.index(Schema) < records.index(Channel) < records.index(DataEnd)
    assert Bag(tmp_path / "announced.mcap").topics["/pose"].typename == POSE
    assert len(Recording(tmp_path / "announced.mcap").columns("/pose")["log_time_ns"]) == 0


def test_a_clock_that_jumps_back_still_closes_chunks(tmp_path):
    path = tmp_path / "back.mcap"
    with McapSink(path) as sink:
        channel = sink.add_channel("/word", STRING)
        times = np.tile(np.arange(0, 30_000, 10) * MS, 2)
        for part in np.array_split(times, 40):
            sink.write_columns(Columns(channel, part, [text("x")] * len(part)))
        assert Bag(path).topics["/word"].count == 6000, "what was handed over is on the disk"
    summary = summary_of(path)
    spans = [c.message_end_time - c.message_start_time for c in summary.chunk_indexes]
    assert max(spans) <= SECOND_NS
    assert summary.statistics.message_count == 6000


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_an_exception_leaves_a_finished_file(tmp_path, error):
    path = tmp_path / "a.mcap"
    with pytest.raises(error), McapSink(path) as sink:
        channel = sink.add_channel("/word", STRING)
        sink.write_columns(Columns(channel, np.array([0]), [text("before")]))
        raise error
    assert summary_of(path).statistics.message_count == 1


def test_bad_input_is_named(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        McapSink(tmp_path / "nowhere" / "a.mcap")
    none, one = np.zeros(0, int), np.zeros(1, int)
    with McapSink(tmp_path / "a.mcap") as sink:
        channel = sink.add_channel("/pose", POSE)
        assert sink.add_channel("/pose", POSE) == channel
        for match, wrong in {
            "'/pose' has type std_msgs/msg/String": lambda: sink.add_channel("/pose", STRING),
            "no_msgs/msg/Nothing": lambda: sink.add_channel("/x", "no_msgs/msg/Nothing"),
            "channel '8'": lambda: sink.write_columns(Columns(8, one, poses(1))),
            "0 log times": lambda: sink.write_columns(Columns(channel, none, poses(1))),
            "from 0 up": lambda: sink.write_columns(Columns(channel, one - 1, poses(1))),
            "float64": lambda: sink.write_columns(Columns(channel, one + 0.5, poses(1))),
        }.items():
            with pytest.raises(InputError, match=match):
                wrong()
    assert Bag(sink.path, check=True).damage == []

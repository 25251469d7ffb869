from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.summary import Summary
from mcap.writer import CompressionType, IndexType, Writer
from random_messages import examples

from tombo_bag.columnar_cdr import encode, layout
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.formats.reader import Bag
from tombo_bag.recording import Recording
from tombo_bag.schemas import schema_text
from tombo_dynamics.errors import InputError

POSE = "geometry_msgs/msg/PoseStamped"
STRING = "std_msgs/msg/String"
JOINTS = "sensor_msgs/msg/JointState"
MS = 1_000_000
LAST_MS = 5200


def write_sample(path):
    records = layout(POSE, {"header": {"frame_id": "map"}}).records(LAST_MS)
    records["pose.position.x"] = np.random.default_rng(0).normal(size=LAST_MS)
    with McapSink(path) as sink:
        pose, word = sink.add_channel("/pose", POSE), sink.add_channel("/word", STRING)
        words = [encode(STRING, {"data": f"word {i}"}) for i in range(LAST_MS // 10)]
        sink.write_columns(
            Columns(pose, np.arange(LAST_MS) * MS, records),
            Columns(word, np.arange(len(words)) * 10 * MS, words),
        )
    return path.read_bytes(), records["pose.position.x"].copy()


def summary_of(path):
    with path.open("rb") as file:
        return make_reader(file).get_summary()


@dataclass(frozen=True, repr=False)
class Sample:
    folder: Path
    content: bytes
    x: np.ndarray
    summary: Summary


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sample")
    content, x = write_sample(folder / "whole.mcap")
    return Sample(folder, content, x, summary_of(folder / "whole.mcap"))


EXAMPLES = examples(60)


@pytest.mark.slow
@EXAMPLES
@given(share=st.floats(0.0, 1.0, exclude_max=True), tail=st.booleans())
def test_a_file_cut_anywhere_gives_all_that_is_whole(sample, share, tail):
    content, x, summary = sample.content, sample.x, sample.summary
    size = int(share * len(content)) if not tail else len(content) - 1 - int(share * 2000)
    if size == 0:
        return
    path = sample.folder / "cut.mcap"
    path.write_bytes(content[:size])
    bag = Bag(path)
    assert bag.damage, "a cut is always noticed"
    whole = [
        chunk
        for chunk in summary.chunk_indexes
        if chunk.chunk_start_offset + chunk.chunk_length <= size
    ]
    expected = sum(
        chunk.message_end_time // MS - chunk.message_start_time // MS + 1 for chunk in whole
    )
    if expected:
        table = Recording(bag.path).columns("/pose")
        assert len(table["log_time_ns"]) >= expected
        np.testing.assert_array_equal(table["pose.position.x"], x[: len(table["log_time_ns"])])
        words = Recording(bag.path).columns("/word")["data"]
        assert list(words) == [f"word {i}" for i in range(len(words))]
    assert len(bag.damage) == 1 and "\n" not in bag.damage[0]


def test_the_part_of_a_chunk_that_is_there_is_read(tmp_path):
    path = tmp_path / "cut.mcap"
    library_file(path, compression=CompressionType.NONE)
    (chunk,) = summary_of(path).chunk_indexes
    content = path.read_bytes()
    path.write_bytes(content[: chunk.chunk_start_offset + chunk.chunk_length // 2])
    bag = Bag(path)
    table = Recording(path).columns("/joints")
    assert 230 < len(table["log_time_ns"]) < 270
    np.testing.assert_array_equal(table["log_time_ns"] // 10**7, 500 - table["publish_time_ns"])
    (damage,) = bag.damage
    assert f"inside chunk at byte {chunk.chunk_start_offset}" in damage


@pytest.mark.slow
@EXAMPLES
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_never_gives_wrong_messages(sample, place, bit):
    content, x, summary = sample.content, sample.x, sample.summary
    at = 8 + int(place * (len(content) - 8))
    broken = bytearray(content)
    broken[at] ^= 1 << bit
    path = sample.folder / "flipped.mcap"
    path.write_bytes(broken)
    bag = Bag(path, check=True)
    if "/pose" not in bag.topics:
        assert bag.damage
        return
    hit = [
        chunk
        for chunk in summary.chunk_indexes
        if chunk.chunk_start_offset + 60 <= at < chunk.chunk_start_offset + chunk.chunk_length
    ]
    try:
        table = Recording(bag.path).columns("/pose")
        read = table["pose.position.x"]
    except InputError:  # a definition: it stands unpacked in the summary alone
        assert at >= int.from_bytes(content[-28:-20], "little")
        return
    rows = table["log_time_ns"] // MS
    if hit and bag.damage:
        (damage,) = bag.damage
        assert f"byte {hit[0].chunk_start_offset} " in damage and "is corrupt" in damage
        first, last = hit[0].message_start_time // MS, hit[0].message_end_time // MS
        assert set(rows.tolist()) == set(range(LAST_MS)) - set(range(first, last + 1))
    elif not bag.damage:
        assert len(rows) == LAST_MS
    np.testing.assert_array_equal(read, x[rows])


def test_zeros_at_the_end_are_noticed(tmp_path):
    """Files after a power failure."""
    content, _ = write_sample(tmp_path / "whole.mcap")
    chunk = summary_of(tmp_path / "whole.mcap").chunk_indexes[3]
    path = tmp_path / "zeros.mcap"
    path.write_bytes(content[: chunk.chunk_start_offset] + bytes(5000))
    bag = Bag(path)
    assert bag.topics["/pose"].count == 3000
    assert f"cut off at byte {chunk.chunk_start_offset}: the 5000 bytes" in bag.damage[0]


def library_file(path, **options):
    """A file as other programs write it."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start("ros2")
        schema = writer.register_schema(JOINTS, "ros2msg", schema_text(JOINTS).encode())
        channels = [writer.register_channel("/joints", "cdr", schema) for _ in range(2)]
        for i in range(500):
            values = {"header": {"frame_id": "b"}, "position": [i, 2.0], "effort": [0.5] * (i % 3)}
            if i % 3:
                values["name"] = ["left", "right"]
            writer.add_message(channels[i % 2], (500 - i) * 10**7, encode(JOINTS, values), i, i)
        writer.finish()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": CompressionType.LZ4, "chunk_size": 5000},
        {"use_chunking": False},
        {"index_types": IndexType.NONE},
        {"repeat_channels": False, "repeat_schemas": False},
    ],
)
def test_files_of_other_writers_and_messages_of_many_shapes(tmp_path, options):
    path = tmp_path / "foreign.mcap"
    library_file(path, **options)
    bag = Bag(path)
    table = Recording(bag.path).columns("/joints")
    assert bag.damage == []
    assert bag.topics["/joints"].count == 500
    number = 499 - np.arange(500)
    np.testing.assert_array_equal(table["log_time_ns"], (500 - number) * 10**7)
    np.testing.assert_array_equal(table["publish_time_ns"], number)
    np.testing.assert_array_equal(table["position"], np.stack([number, 0 * number + 2.0], axis=1))
    assert [len(effort) for effort in table["effort"]] == [n % 3 for n in number]
    assert table["effort"][0].tolist() == [0.5] * (499 % 3)
    assert table["name[1]"].tolist() == ["right" if n % 3 else "" for n in number]
    assert set(table["header.frame_id"]) == {"b"}
    assert table["velocity"].shape == (500, 0)


def test_numbers_that_some_messages_lack_are_nan(tmp_path):
    typename = "visualization_msgs/msg/MarkerArray"
    messages = [
        encode(typename, {"markers": [{"id": 5, "pose": {"position": {"x": 1.0}}}] * count})
        for count in (1, 0, 2)
    ]
    with McapSink(tmp_path / "a.mcap") as sink:
        channel = sink.add_channel("/markers", typename)
        sink.write_columns(Columns(channel, np.arange(3), messages))
    table = Recording(tmp_path / "a.mcap").columns("/markers")
    np.testing.assert_array_equal(table["markers[0].pose.position.x"], [1.0, np.nan, 1.0])
    np.testing.assert_array_equal(table["markers[1].id"], [np.nan, np.nan, 5.0])


def test_messages_of_another_encoding_are_listed_but_not_read(tmp_path):
    path = tmp_path / "json.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("")
        schema = writer.register_schema("thing", "jsonschema", b"{}")
        channel = writer.register_channel("/thing", "json", schema)
        writer.add_message(channel, 5, b"{}", 5)
        writer.finish()
    assert Bag(path).topics["/thing"].count == 1
    with pytest.raises(InputError, match=r"json\.mcap.*/thing.*'json'.*accepted: 'cdr'"):
        Recording(path).columns("/thing")

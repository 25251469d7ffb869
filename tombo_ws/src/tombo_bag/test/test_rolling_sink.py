import contextlib
import errno
import os
from collections import Counter
from io import FileIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from random_messages import examples
from rosbags.rosbag2 import Reader

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.formats import mcap_sink
from tombo_bag.formats.reader import Bag
from tombo_bag.formats.rolling_sink import RollingOptions, RollingSink
from tombo_bag.qos import EVENT, SENSOR, STATE
from tombo_bag.recording import Recording
from tombo_bag.schemas import known_types, load_installed_type, schema_text, type_hash
from tombo_dynamics.errors import InputError

STRING = "std_msgs/msg/String"
MS = 1_000_000
START = 1_700_000_000_000_000_000
TOPICS = {"/a": SENSOR, "/b": STATE, "/c": EVENT}
EXAMPLES = examples(25)


def bag_files(folder):
    return sorted(folder.glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2]))


def word(text):
    return encode(STRING, {"data": text})


def opened(folder, notes=dict, **options):
    sink = RollingSink(RollingOptions(folder, **options), notes)
    for name, qos in TOPICS.items():
        sink.add_topic(name, STRING, qos)
    return sink


def fresh(tmp_path_factory):
    return tmp_path_factory.mktemp("bags") / "bag"


def read(folder):
    """(topic, log time, bytes) of all messages, file by file."""
    found = []
    for path in bag_files(folder):
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            found.append([(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()])
    return found


@pytest.mark.slow
@EXAMPLES
@given(
    messages=st.lists(st.tuples(st.sampled_from([*TOPICS]), st.integers(0, 4000)), max_size=40),
    flush_every=st.integers(1, 30),
    file_size_max=st.sampled_from([0, 1, 3000, 8000]),
)
def test_splitting_loses_and_doubles_nothing(
    tmp_path_factory, messages, flush_every, file_size_max
):
    folder = fresh(tmp_path_factory)
    sink = opened(folder, file_size_max=file_size_max)
    written = []
    for i, (topic, milliseconds) in enumerate(messages):
        time = START + milliseconds * MS
        sink.write(topic, word(str(i)), time, time - MS)
        written.append((topic, time, word(str(i))))
        if i % flush_every == 0:
            sink.flush()
    sink.close()
    files = read(folder)
    assert Counter(item for file in files for item in file) == Counter(written)
    with Reader(folder) as reader:
        assert reader.message_count == len(written) == sink.messages
        assert sum(1 for _ in reader.messages()) == len(written)
        if written:
            times = [time for _, time, _ in written]
            assert reader.start_time == min(times)
            assert reader.end_time == max(times) + 1
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts == {name: sum(t == name for t, _, _ in written) for name in TOPICS}
    for path in bag_files(folder):
        assert Bag(path, check=True).damage == []


def test_each_file_begins_with_the_records_given(tmp_path):
    sink = RollingSink(
        RollingOptions(tmp_path / "bag", file_size_max=1), records={"scenario": {"a": "b"}}
    )
    sink.add_topic("/a", STRING, STATE)
    for i in range(3):
        sink.write("/a", word(str(i)), START + i, START)
        sink.flush()
    sink.close()
    for path in bag_files(tmp_path / "bag"):
        assert list(Bag(path).metadata) == ["scenario", RECORDER_METADATA]
        assert Bag(path).metadata["scenario"] == {"a": "b"}


def test_files_end_at_a_size(tmp_path):
    sink = opened(tmp_path / "bag", file_size_max=10_000)
    content = np.random.default_rng(0).integers(33, 127, (1000, 40), np.uint8)
    for i in range(1000):
        sink.write("/a", word(content[i].tobytes().decode()), START + i * 2 * MS, START)
        if i % 100 == 99:
            sink.flush()
    sink.close()
    files = bag_files(tmp_path / "bag")
    sizes = [path.stat().st_size for path in files]
    assert len(sizes) > 3 and all(10_000 <= size < 30_000 for size in sizes[:-1])
    assert [path.name for path in files[:2]] == ["bag_0.mcap", "bag_1.mcap"]


def test_flushed_messages_survive_a_crash_and_are_read_without_metadata(tmp_path):
    sink = opened(tmp_path / "bag", file_size_max=6000)
    for i in range(300):
        sink.write("/a", word(str(i)), START + i * 10 * MS, START)
        if i % 40 == 39:
            sink.flush()
    *whole, last = (Bag(path) for path in bag_files(tmp_path / "bag"))
    assert whole and all(bag.damage == [] for bag in whole)
    assert sum(bag.topics["/a"].count for bag in (*whole, last)) == 280
    assert "the writer was not closed" in last.damage[0]
    assert not (tmp_path / "bag" / "metadata.yaml").exists()


def test_a_topic_found_late_stands_in_the_later_files_and_in_the_metadata(tmp_path):
    sink = RollingSink(RollingOptions(tmp_path / "bag", file_size_max=1))
    sink.add_topic("/a", STRING, SENSOR)
    sink.write("/a", word("1"), START, START)
    sink.flush()
    sink.add_topic("/late", STRING, EVENT)  # between two files
    sink.add_topic("/late", STRING, STATE)
    sink.add_topic("/silent", STRING, EVENT)
    sink.write("/late", word("2"), START + 1, START)
    sink.close()
    with Reader(tmp_path / "bag") as reader:
        assert [(c.topic, t - START) for c, t, _ in reader.messages()] == [("/a", 0), ("/late", 1)]
        assert {c.topic: c.msgcount for c in reader.connections} == {
            "/a": 1,
            "/late": 1,
            "/silent": 0,
        }
    with pytest.raises(InputError, match=r"'/late' has type std_msgs/msg/Bool; it is std_msgs/"):
        sink.add_topic("/late", "std_msgs/msg/Bool", EVENT)


def test_a_single_file(tmp_path):
    path = tmp_path / "flight.mcap"
    notes = {"lost": "0"}
    sink = opened(path, lambda: notes, single_file=True)
    sink.write("/a", word("1"), START, START - 5)
    notes["lost"] = "3"
    sink.close()
    sink.close()
    assert os.listdir(tmp_path) == ["flight.mcap"]
    ((message, values),) = decoded(path)
    assert values.data == "1"
    assert (message.log_time, message.publish_time) == (START, START - 5)
    records = Bag(path).metadata
    assert records == {RECORDER_METADATA: {"lost": "3"}}
    with Reader(path) as reader:
        assert reader.message_count == 1


def decoded(path):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(message, values) for _, _, message, values in reader.iter_decoded_messages()]


class SmallDisk(FileIO):
    """Room in bytes for all files together; what does not fit is cut off."""

    room = 0
    files = ()

    def __init__(self, *args):
        super().__init__(*args)
        SmallDisk.files += (self,)

    def write(self, data):
        used = sum(
            os.path.getsize(file.name) for file in SmallDisk.files if os.path.exists(file.name)
        )
        part = bytes(data)[: max(SmallDisk.room - used, 0)]
        if not part:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(part)


@pytest.mark.slow
@EXAMPLES
@given(room=st.integers(500, 60_000), file_size_max=st.sampled_from([0, 15_000]))
def test_a_full_disk_ends_the_recording_and_what_was_written_is_read(
    tmp_path_factory, room, file_size_max
):
    folder = fresh(tmp_path_factory)
    SmallDisk.room, SmallDisk.files = room, ()
    content = np.random.default_rng(room).integers(33, 127, (2000, 60), np.uint8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mcap_sink, "FileIO", SmallDisk)
        sink = opened(folder, file_size_max=file_size_max)
        written, failed = 0, False
        try:
            for i, row in enumerate(content):
                sink.write("/b", word(row.tobytes().decode()), START + i * MS, START)
                written += 1
                if i % 20 == 19:
                    sink.flush()
        except OSError as error:
            assert error.errno == errno.ENOSPC
            failed = True
        with contextlib.suppress(OSError):
            sink.close()
    assert failed
    assert sink.messages + sink.unwritten == written
    with Recording(folder) as recording:
        if sink.messages:
            raw = recording.messages("/b")
            assert raw.log_times_ns.tolist() == [START + i * MS for i in range(sink.messages)]
            assert raw.messages[-1] == word(content[sink.messages - 1].tobytes().decode())
        closed = (folder / "metadata.yaml").exists()
        assert closed or recording.damage, "a file without its end is named"
    if closed:
        with Reader(folder) as reader:
            assert reader.message_count == sink.messages == sum(1 for _ in reader.messages())


def test_a_file_that_could_not_be_finished_is_not_written_again(tmp_path):
    SmallDisk.room, SmallDisk.files = 4000, ()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mcap_sink, "FileIO", SmallDisk)
        sink = opened(tmp_path / "bag")
        sink.write("/a", word("kept"), START, START)
        sink.flush()
        SmallDisk.room = 0
        with pytest.raises(OSError, match="No space"):
            sink.close()
        SmallDisk.room = 10**6
        sink.write("/a", word("late"), START + 1, START)
        with pytest.raises(FileExistsError):
            sink.flush()
    assert sink.unwritten == 1
    with Recording(tmp_path / "bag") as recording:
        assert recording.columns("/a")["data"].tolist() == ["kept"]


def test_bad_targets_and_options_are_named_and_leave_nothing(tmp_path):
    (tmp_path / "file").touch()
    os.symlink(tmp_path / "nowhere", tmp_path / "link")
    single = {"single_file": True}
    for target, options, match in [
        ("file", {}, "is there already; accepted: a new name"),
        ("link", {}, "is there already; accepted: a new name"),
        ("file/bag", {}, r"can't make folder .*Not a directory"),
        ("none/a.mcap", single, r"can't write .*No such file"),
        ("bag", {"file_size_max": -1}, "file_size_max is -1; accepted: 0 or more"),
        ("a.mcap", {**single, "file_size_max": 1}, "is 1; accepted: 0 with a single"),
        ("a.bag", single, r"a\.bag'; accepted: a name ending in \.mcap"),
    ]:
        with pytest.raises(InputError, match=match):
            RollingSink(RollingOptions(tmp_path / target, **options))
    for room in (10, 60):  # no room for the header, for the first record
        SmallDisk.room, SmallDisk.files = room, ()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(mcap_sink, "FileIO", SmallDisk)
            with pytest.raises(InputError, match=r"can't write '.*bag_0\.mcap': No space left"):
                RollingSink(RollingOptions(tmp_path / "bag"), records={"long": {"a": "b" * 99}})
    assert sorted(os.listdir(tmp_path)) == ["file", "link"]


def test_types_of_installed_packages_are_learned(tmp_path, monkeypatch):
    folder = tmp_path / "prefix" / "share" / "my_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Part.msg").write_text("# a part\nuint8 KIND=3\nfloat64 x 1.5\n")
    (folder / "Whole.msg").write_text("std_msgs/Header header\nPart[<=2] parts\nstring<=9 name\n")
    (folder / "Broken.msg").write_text("{y} 3\n")
    (folder / "Lacking.msg").write_text("your_msgs/Thing thing\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    with pytest.raises(InputError, match="my_msgs/msg/Broken"):
        load_installed_type("my_msgs/msg/Broken")
    with pytest.raises(InputError, match=r"type in my_msgs/msg/Lacking 'your_msgs/msg/Thing'"):
        load_installed_type("my_msgs/msg/Lacking")
    for name in ("my_msgs/srv/Ask_Event", "my_msgs/msg/../Part", "Part", ""):
        with pytest.raises(InputError, match="unknown message type"):
            load_installed_type(name)
    load_installed_type("my_msgs/msg/Whole")
    assert {"my_msgs/msg/Whole", "my_msgs/msg/Part"} <= known_types().keys()
    text = schema_text("my_msgs/msg/Whole")
    assert "MSG: my_msgs/Part\n" in text and "MSG: std_msgs/Header\n" in text
    assert type_hash("my_msgs/msg/Whole").startswith("RIHS01_")
    sink = RollingSink(RollingOptions(tmp_path / "bag"))
    sink.add_topic("/whole", "my_msgs/msg/Whole", STATE)
    values = {"name": "n", "parts": [{"x": 2.5}, {"x": 3.5}]}
    sink.write("/whole", encode("my_msgs/msg/Whole", values), START, START)
    sink.close()
    ((_, values),) = decoded(tmp_path / "bag" / "bag_0.mcap")
    assert [part.x for part in values.parts] == [2.5, 3.5]

import contextlib
import errno
import os
from collections import Counter
from io import FileIO

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from random_messages import examples
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight_time import RECORDER_METADATA
from tombo_bag.formats import mcap_sink
from tombo_bag.formats.bag_sink import BagSink
from tombo_bag.formats.reader import Bag
from tombo_bag.qos import EVENT, SENSOR, STATE
from tombo_bag.recording import Recording
from tombo_bag.schemas import known_types, load_installed_type, schema_text, type_hash, type_store
from tombo_dynamics.errors import InputError

STRING = "std_msgs/msg/String"
MS = 1_000_000
START = 1_700_000_000_000_000_000
TOPICS = {"/a": SENSOR, "/b": STATE, "/c": EVENT}
EXAMPLES = examples(25)


def word(text):
    return encode(STRING, {"data": text})


def opened(target, notes=dict, records=None):
    sink = BagSink(target, notes, records)
    for name, qos in TOPICS.items():
        sink.add_topic(name, STRING, qos)
    return sink


@pytest.mark.slow
@EXAMPLES
@given(
    messages=st.lists(st.tuples(st.sampled_from([*TOPICS]), st.integers(0, 4000)), max_size=40),
    flush_every=st.integers(1, 30),
)
def test_a_folder_has_every_message_once_with_counts_times_and_qos(
    tmp_path_factory, messages, flush_every
):
    folder = tmp_path_factory.mktemp("bags") / "größe: 1"
    notes = {"lost:/a": "0", "#note": "a: b\nc"}
    sink = opened(folder, lambda: notes, {"scenario": {"a": "b"}})
    written = []
    for i, (topic, milliseconds) in enumerate(messages):
        time = START + milliseconds * MS
        sink.write(topic, word(str(i)), time, time - MS)
        written.append((topic, time, word(str(i))))
        if i % flush_every == 0:
            sink.flush()
    sink.close()
    with Reader(folder) as reader:
        read = [(connection.topic, time, data) for connection, time, data in reader.messages()]
        assert Counter(read) == Counter(written)
        assert reader.message_count == len(written) == sink.messages
        if written:
            times = [time for _, time, _ in written]
            assert (reader.start_time, reader.end_time) == (min(times), max(times) + 1)
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts == {name: sum(t == name for t, _, _ in written) for name in TOPICS}
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles
            given_qos = TOPICS[connection.topic]
            assert qos.depth == given_qos.depth
            assert qos.reliability.name.lower() == given_qos.reliability
            assert qos.durability.name.lower() == given_qos.durability
        assert reader.storage.metadata.custom == notes
    assert {path.name for path in folder.iterdir()} == {f"{folder.name}_0.mcap", "metadata.yaml"}
    bag = Bag(sink.path, check=True)
    assert bag.damage == []
    assert bag.metadata == {"scenario": {"a": "b"}, RECORDER_METADATA: notes}


def shape(value):
    """Names and types, without values."""
    if isinstance(value, dict):
        return {key: shape(item) for key, item in value.items()}
    if isinstance(value, list):
        return [shape(item) for item in value[:1]]
    return type(value)


def test_the_metadata_look_like_that_of_another_writer(tmp_path):
    with Writer(tmp_path / "theirs", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        time = QosTime(1, 2)
        qos = Qos(
            QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, QosDurability.VOLATILE,
            time, time, QosLiveliness.AUTOMATIC, time, False,
        )  # fmt: skip
        connection = writer.add_connection(
            "/a", STRING, typestore=type_store(), offered_qos_profiles=[qos]
        )
        writer.write(connection, 5, word("1"))
    sink = opened(tmp_path / "ours")
    sink.write("/a", word("1"), 5, 5)
    sink.close()
    theirs, ours = (
        yaml.safe_load((tmp_path / name / "metadata.yaml").read_text())
        for name in ("theirs", "ours")
    )
    assert shape(ours) == shape(theirs)
    information = ours["rosbag2_bagfile_information"]
    assert information["version"] == 9 and information["ros_distro"] == "jazzy"


def test_metadata_that_can_not_be_written_leave_nothing(tmp_path):
    sink = opened(tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").mkdir()
    with pytest.raises(OSError):
        sink.close()
    assert sorted(os.listdir(tmp_path / "bag")) == ["bag_0.mcap", "metadata.yaml"]


def test_flushed_messages_survive_a_crash_and_are_read_without_metadata(tmp_path):
    sink = opened(tmp_path / "bag")
    for i in range(300):
        sink.write("/a", word(str(i)), START + i * 10 * MS, START)
        if i % 40 == 39:
            sink.flush()
    with Recording(tmp_path / "bag") as recording:
        assert recording.topics["/a"].count == 280
        assert "the writer was not closed" in recording.damage[0]
    assert not (tmp_path / "bag" / "metadata.yaml").exists()


def test_a_single_file(tmp_path):
    path = tmp_path / "flight.mcap"
    notes = {"lost": "0"}
    sink = opened(path, lambda: notes)
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
@given(room=st.integers(500, 60_000))
def test_a_full_disk_ends_the_recording_and_what_was_written_is_read(tmp_path_factory, room):
    folder = tmp_path_factory.mktemp("bags") / "bag"
    SmallDisk.room, SmallDisk.files = room, ()
    content = np.random.default_rng(room).integers(33, 127, (2000, 60), np.uint8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mcap_sink, "FileIO", SmallDisk)
        sink = opened(folder)
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


def test_bad_targets_are_named_and_leave_nothing(tmp_path):
    (tmp_path / "file").touch()
    os.symlink(tmp_path / "nowhere", tmp_path / "link")
    for target, match in [
        ("file", "is there already; accepted: a new name"),
        ("link", "is there already; accepted: a new name"),
        ("file/bag", r"can't make folder .*Not a directory"),
        ("none/a.mcap", r"can't write .*No such file"),
    ]:
        with pytest.raises(InputError, match=match):
            BagSink(tmp_path / target)
    for room in (10, 60):  # no room for the header, for the first record
        SmallDisk.room, SmallDisk.files = room, ()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(mcap_sink, "FileIO", SmallDisk)
            with pytest.raises(InputError, match=r"can't write '.*bag_0\.mcap': No space left"):
                BagSink(tmp_path / "bag", records={"long": {"a": "b" * 99}})
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
    sink = BagSink(tmp_path / "bag")
    sink.add_topic("/whole", "my_msgs/msg/Whole", STATE)
    values = {"name": "n", "parts": [{"x": 2.5}, {"x": 3.5}]}
    sink.write("/whole", encode("my_msgs/msg/Whole", values), START, START)
    sink.close()
    ((_, values),) = decoded(tmp_path / "bag" / "bag_0.mcap")
    assert [part.x for part in values.parts] == [2.5, 3.5]

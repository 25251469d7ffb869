import pytest
import yaml
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from tombo_bag.columnar_cdr import encode
from tombo_bag.formats.bag_metadata import FileEntry, TopicEntry, write_metadata
from tombo_bag.formats.mcap_sink import McapSink
from tombo_bag.qos import EVENT, SENSOR
from tombo_bag.schemas import type_store
from tombo_dynamics.time_base import SECOND_NS

STRING = "std_msgs/msg/String"
START = 1_700_000_000 * SECOND_NS


def sample():
    files = (
        FileEntry("my bag: 1_0.mcap", START, START + 2 * SECOND_NS, 3),
        FileEntry("my bag: 1_1.mcap", START + 3 * SECOND_NS, START + 5 * SECOND_NS, 4),
        FileEntry("my bag: 1_2.mcap", 0, 0, 0),
    )
    topics = (TopicEntry("/event", STRING, EVENT, 2), TopicEntry("/größe", STRING, SENSOR, 5))
    return files, topics, {"lost:/event": "0", "#note": "a: b\nc"}


def shape(value):
    """Names and types, without values."""
    if isinstance(value, dict):
        return {key: shape(item) for key, item in value.items()}
    if isinstance(value, list):
        return [shape(item) for item in value[:1]]
    return type(value)


def test_the_file_looks_like_that_of_another_writer(tmp_path):
    with Writer(tmp_path / "theirs", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        from rosbags.interfaces import Qos, QosHistory, QosLiveliness, QosTime

        time = QosTime(1, 2)
        qos = Qos(
            QosHistory.KEEP_LAST,
            10,
            QosReliability.RELIABLE,
            QosDurability.VOLATILE,
            *(time, time, QosLiveliness.AUTOMATIC, time, False),
        )
        connection = writer.add_connection(
            "/event", STRING, typestore=type_store(), offered_qos_profiles=[qos]
        )
        writer.write(connection, 5, encode(STRING, {}))
    theirs = yaml.safe_load((tmp_path / "theirs" / "metadata.yaml").read_text())
    write_metadata(tmp_path, *sample())
    ours = yaml.safe_load((tmp_path / "metadata.yaml").read_text())
    wanted, found = (bag["rosbag2_bagfile_information"] for bag in (theirs, ours))
    found["custom_data"] = None
    assert shape(found) == shape(wanted)
    assert found["version"] == 9 and found["ros_distro"] == "jazzy"


def test_rosbags_reads_counts_times_and_qos(tmp_path):
    files, topics, custom = sample()
    for file in files:
        with McapSink(tmp_path / file.name):
            pass
    write_metadata(tmp_path, files, topics, custom)
    with Reader(tmp_path) as reader:
        assert reader.message_count == 7
        assert (reader.start_time, reader.end_time) == (START, START + 5 * SECOND_NS + 1)
        event, other = reader.connections
        assert (event.topic, event.msgcount, other.topic, other.msgcount) == (
            *("/event", 2),
            *("/größe", 5),
        )
        (qos,) = event.ext.offered_qos_profiles
        assert qos.durability == QosDurability.TRANSIENT_LOCAL
        (qos,) = other.ext.offered_qos_profiles
        assert qos.reliability == QosReliability.BEST_EFFORT and qos.depth == 5
        assert reader.storage.metadata.custom == custom
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_metadata_that_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / "metadata.yaml").mkdir()
    with pytest.raises(OSError):
        write_metadata(tmp_path, *sample())
    assert [path.name for path in tmp_path.iterdir()] == ["metadata.yaml"]

"""Two recordings compared: equal topics, different topics, and sizes of differences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from tombo_bag.columnar_cdr import encode
from tombo_bag.comparison import Comparison, compare_recordings
from tombo_bag.flight_time import stamp
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import EPOCH_NS

POSE = "geometry_msgs/msg/PoseStamped"
STEP_NS = 10_000_000
Messages = list[tuple[int, dict[str, Any]]]


def poses(number: int = 20) -> Messages:
    """Return (time of receipt, message) pairs, one each 10 ms from flight time 0."""
    return [
        (
            EPOCH_NS + i * STEP_NS + 1000,
            {
                "header": {"stamp": stamp(EPOCH_NS + i * STEP_NS), "frame_id": "map"},
                "pose": {"position": {"x": 0.5 * i, "y": -1.0}, "orientation": {"w": 1.0}},
            },
        )
        for i in range(number)
    ]


def write(path: Path, topics: dict[str, tuple[str, Messages]]) -> Path:
    with McapSink(path) as sink:
        sink.add_metadata("tombo_flight", {"epoch_ns": str(EPOCH_NS)})
        for name, (kind, messages) in topics.items():
            channel = sink.add_channel(name, kind)
            times = np.array([time for time, _ in messages], np.int64)
            content = [encode(kind, message) for _, message in messages]
            sink.write_columns(Columns(channel, times, content))
    return path


def compared(tmp_path: Path, a: Messages, b: Messages, kind: str = POSE) -> Comparison:
    one = write(tmp_path / "a.mcap", {"/pose": (kind, a)})
    two = write(tmp_path / "b.mcap", {"/pose": (kind, b)})
    return compare_recordings(one, two)


def test_recording_is_equal_to_itself(tmp_path):
    found = compared(tmp_path, poses(), poses())
    assert found.equal and found.damage == ()
    assert found.as_list() == [
        {
            "topic": "/pose",
            "messages_a": 20,
            "messages_b": 20,
            "equal": True,
            "first_difference_s": None,
            "first_difference": None,
            "largest": None,
            "largest_field": None,
            "only_in_a": 0,
            "only_in_b": 0,
            "fields": [],
        }
    ]


def test_one_changed_field_is_named_with_time_and_size(tmp_path):
    other = poses()
    other[7][1]["pose"]["position"]["x"] += 0.25
    other[9][1]["pose"]["position"]["x"] -= 2.0
    (topic,) = compared(tmp_path, poses(), other).as_list()
    assert topic["equal"] is False
    assert topic["first_difference_s"] == pytest.approx(0.07, abs=1e-12)
    assert topic["first_difference"] == topic["largest_field"] == "pose.position.x"
    assert topic["largest"] == 2.0
    assert [(f["field"], f["messages"]) for f in topic["fields"]] == [("pose.position.x", 2)]


def test_last_bit_and_sign_of_zero_are_differences(tmp_path):
    for field, value in (("x", np.nextafter(3.5, 4.0)), ("z", -0.0)):
        other = poses()
        other[7][1]["pose"]["position"][field] = float(value)
        (topic,) = compared(tmp_path, poses(), other).topics
        assert topic.first == (EPOCH_NS + 7 * STEP_NS, f"pose.position.{field}")


def test_nan_equals_nan_and_differs_from_a_number(tmp_path):
    one, two = poses(), poses()
    for messages in (one, two):
        messages[3][1]["pose"]["position"]["y"] = float("nan")
    assert compared(tmp_path, one, two).equal
    (topic,) = compared(tmp_path, one, poses()).as_list()
    assert topic["first_difference"] == "pose.position.y"
    assert topic["largest"] is None


def test_missing_message_is_found_on_either_side(tmp_path):
    less = poses()
    del less[4]
    for a, b, side in ((poses(), less, "A"), (less, poses(), "B")):
        (topic,) = compared(tmp_path, a, b).topics
        assert topic.first == (EPOCH_NS + 4 * STEP_NS, f"message in {side} only")
        assert topic.fields == ()


def test_order_and_times_of_receipt_do_not_matter(tmp_path):
    times = [time for time, _ in poses()]
    other = [(time + 5, message) for time, (_, message) in zip(times, poses()[::-1], strict=True)]
    assert compared(tmp_path, poses(), other).equal


def test_messages_of_one_stamp_are_paired_in_any_order(tmp_path):
    one = poses(4)
    for _, message in one:
        message["header"]["stamp"] = stamp(EPOCH_NS)
    other = [(time, message) for (time, _), (_, message) in zip(one, one[::-1], strict=True)]
    assert compared(tmp_path, one, other).equal
    other[0][1]["pose"]["position"]["x"] = 9.0
    (topic,) = compared(tmp_path, poses(4)[:0] + one[:3], other[1:]).topics
    assert (topic.messages_a, topic.messages_b) == (3, 3)


def test_type_without_header_is_paired_by_publish_time(tmp_path):
    one = [(EPOCH_NS + i, {"data": float(i)}) for i in range(5)]
    kind = "std_msgs/msg/Float64"
    assert compared(tmp_path, one, one, kind).equal
    (topic,) = compared(tmp_path, one, [(one[0][0], {"data": 3.0}), *one[1:]], kind).topics
    assert topic.first == (EPOCH_NS, "data") and topic.fields[0].largest == 3.0


def test_transforms_are_paired_by_the_stamp_inside(tmp_path):
    def at(i: int) -> dict[str, Any]:
        header = {"stamp": stamp(EPOCH_NS + i), "frame_id": "map"}
        return {"transforms": [{"header": header, "child_frame_id": "base_link"}]}

    one = [(EPOCH_NS + i, at(i)) for i in range(5)]
    two = [(EPOCH_NS + 77 * i + 9, at(i)) for i in range(5)]
    assert compared(tmp_path, one, two, "tf2_msgs/msg/TFMessage").equal


def test_element_that_one_recording_lacks_is_a_difference(tmp_path):
    def at(i: int, names: list[str]) -> tuple[int, dict[str, Any]]:
        header = {"stamp": stamp(EPOCH_NS + i)}
        return EPOCH_NS + i, {"header": header, "name": names, "position": [1.0] * len(names)}

    kind = "sensor_msgs/msg/JointState"
    one = [at(i, ["left"]) for i in range(3)]
    two = [at(0, ["left"]), at(1, ["left", "right"]), at(2, ["left"])]
    (topic,) = compared(tmp_path, one, two, kind).topics
    assert {field.field for field in topic.fields} == {"name[1]", "position"}
    assert topic.first is not None and topic.first[0] == EPOCH_NS + 1


def test_topic_of_one_recording_is_a_difference_unless_left_out(tmp_path):
    one = write(tmp_path / "a.mcap", {"/pose": (POSE, poses()), "/more": (POSE, poses(3))})
    two = write(tmp_path / "b.mcap", {"/pose": (POSE, poses())})
    found = compare_recordings(one, two)
    assert [(t.topic, t.equal) for t in found.topics] == [("/more", False), ("/pose", True)]
    assert (found.topics[0].messages_a, found.topics[0].messages_b) == (3, 0)
    assert compare_recordings(one, two, ["/pose"]).equal


def test_topics_of_processes_are_compared_only_where_asked_for(tmp_path):
    one = write(tmp_path / "a.mcap", {"/pose": (POSE, poses()), "/rosout": (POSE, poses(3))})
    two = write(tmp_path / "b.mcap", {"/pose": (POSE, poses())})
    found = compare_recordings(one, two)
    assert found.equal and found.left_out == ("/rosout",)
    assert not compare_recordings(one, two, ["/rosout"]).equal


def test_other_type_under_the_same_topic_is_a_difference(tmp_path):
    one = write(tmp_path / "a.mcap", {"/pose": (POSE, poses())})
    points = [
        (time, {"header": message["header"], "point": {"x": 1.0}}) for time, message in poses()
    ]
    two = write(tmp_path / "b.mcap", {"/pose": ("geometry_msgs/msg/PointStamped", points)})
    (topic,) = compare_recordings(one, two).topics
    assert not topic.equal and topic.first is not None
    assert topic.first[1] == f"type: {POSE} in A, geometry_msgs/msg/PointStamped in B"


@pytest.mark.slow
def test_truncated_file_is_compared_as_far_as_it_goes(tmp_path):
    whole = write(tmp_path / "a.mcap", {"/pose": (POSE, poses(5000))})
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    found = compare_recordings(whole, cut)
    assert not found.equal and found.damage[0].startswith(str(cut))
    assert found.topics[0].fields == ()


def test_unknown_topic_is_refused_with_the_nearest_name(tmp_path):
    one = write(tmp_path / "a.mcap", {"/pose": (POSE, poses())})
    with pytest.raises(InputError, match=r"'/pos' \(did you mean '/pose'\?\)"):
        compare_recordings(one, one, ["/pos"])


@pytest.mark.parametrize(
    ("encoding", "language", "word"),
    [
        ("cdr", "ros2msg", encode("std_msgs/msg/String", {"data": "x"})),
        ("ros1", "ros1msg", b"\x01\0\0\0x"),
    ],
)
def test_topic_that_can_not_be_read_is_reported_and_the_others_are_compared(
    tmp_path, encoding, language, word
):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        for topic, kind, text in (
            ("/word", "std_msgs/msg/String", "string data"),
            ("/measured", "lab_msgs/msg/Reading", "lab_tools/Encoder encoder"),
        ):
            schema = writer.register_schema(kind, language, text.encode())
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, 5, word, 5)
        writer.finish()
    found = compare_recordings(path, path)
    assert [(t.topic, t.equal) for t in found.topics] == [("/word", True)]
    assert any("/measured is not compared" in line for line in found.damage)
    with pytest.raises(InputError, match=r"lab_(tools|msgs)/"):
        compare_recordings(path, path, ["/measured"])

"""Two recordings compared: equal topics, different topics, and sizes of differences."""

from __future__ import annotations

from dataclasses import asdict
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


def test_changed_field_is_named_with_time_and_size(tmp_path):
    topic = asdict(compared(tmp_path, poses(), changed({7: 3.75, 9: 2.5})).topics[0])
    (field,) = topic.pop("fields")
    assert topic == {
        "topic": "/pose", "messages_a": 20, "messages_b": 20, "only_in_a": 0, "only_in_b": 0,
        "equal": False, "first_difference_s": 0.07, "first_difference": "pose.position.x",
        "largest": 2.0,
    }  # fmt: skip
    first = {"messages": 2, "first_difference_s": 0.07, "largest": 2.0}
    assert field == {"field": "pose.position.x", **first}


def changed(values: dict[int, float], field: str = "x") -> Messages:
    """Return the poses with other numbers in a field of the position."""
    messages = poses()
    for i, value in values.items():
        messages[i][1]["pose"]["position"][field] = float(value)
    return messages


def without(i: int) -> Messages:
    return poses()[:i] + poses()[i + 1 :]


def received_later() -> Messages:
    times = [time for time, _ in poses()]
    return [(time + 5, message) for time, (_, message) in zip(times, poses()[::-1], strict=True)]


def numbers(*values: float) -> Messages:
    return [(EPOCH_NS + i, {"data": value}) for i, value in enumerate(values)]


def transforms(delay_ns: int) -> Messages:
    headers = [{"stamp": stamp(EPOCH_NS + i), "frame_id": "map"} for i in range(5)]
    return [
        (EPOCH_NS + i * delay_ns, {"transforms": [{"header": h, "child_frame_id": "base_link"}]})
        for i, h in enumerate(headers)
    ]


def joints(*names: list[str]) -> Messages:
    return [
        (
            EPOCH_NS + i,
            {
                "header": {"stamp": stamp(EPOCH_NS + i)},
                "name": each,
                "position": [1.0] * len(each),
            },
        )
        for i, each in enumerate(names)
    ]


LEFT, BOTH = ["left"], ["left", "right"]
FLOAT, TRANSFORMS, JOINTS = (
    "std_msgs/msg/Float64", "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/JointState",
)  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "a", "b", "first"),
    [
        (POSE, poses(), poses(), None),
        (POSE, poses(), received_later(), None),
        (POSE, changed({3: np.nan}), changed({3: np.nan}), None),
        (POSE, changed({3: np.nan}, "y"), poses(), (3 * STEP_NS, "pose.position.y")),
        (POSE, poses(), changed({7: np.nextafter(3.5, 4.0)}), (7 * STEP_NS, "pose.position.x")),
        (POSE, poses(), changed({7: -0.0}, "z"), (7 * STEP_NS, "pose.position.z")),
        (POSE, poses(), without(4), (4 * STEP_NS, "message in A only")),
        (POSE, without(4), poses(), (4 * STEP_NS, "message in B only")),
        (FLOAT, numbers(0.0, 1.0), numbers(0.0, 1.0), None),
        (FLOAT, numbers(0.0, 1.0), numbers(3.0, 1.0), (0, "data")),
        (TRANSFORMS, transforms(1), transforms(77), None),
        (JOINTS, joints(LEFT, LEFT, LEFT), joints(LEFT, BOTH, LEFT), (1, "position")),
    ],
)
def test_first_difference_of_two_recordings(tmp_path, kind, a, b, first):
    """Paired by the stamp of the header or inside the message, else by the time of publishing."""
    result = compared(tmp_path, a, b, kind)  # of transforms, the bodies besides
    topic = result.topics[0]
    assert result.equal == (first is None)
    assert (topic.first_difference_s, topic.first_difference) == (
        (None, None) if first is None else (first[0] / 1e9, first[1])
    )
    if first and first[1].startswith("message"):
        assert topic.fields == ()
    if kind == JOINTS:
        assert {field.field for field in topic.fields} == {"name[1]", "position"}


def test_messages_of_one_stamp_are_paired_in_any_order(tmp_path):
    one = poses(4)
    for _, message in one:
        message["header"]["stamp"] = stamp(EPOCH_NS)
    other = [(time, message) for (time, _), (_, message) in zip(one, one[::-1], strict=True)]
    assert compared(tmp_path, one, other).equal


def test_which_topics_are_compared(tmp_path):
    """Those of both, and of one alone; those of processes only where they are asked for."""
    both, more = {"/pose": (POSE, poses())}, {"/more": (POSE, poses(3))}
    one = write(tmp_path / "a.mcap", {**both, **more, "/rosout": (POSE, poses(3))})
    two = write(tmp_path / "b.mcap", both)
    first, second = compare_recordings(one, two).topics
    assert (first.topic, first.messages_a, first.messages_b, first.only_in_a) == ("/more", 3, 0, 3)
    assert (second.topic, second.equal) == ("/pose", True)
    assert compare_recordings(one, two, ["/pose"]).equal
    assert not compare_recordings(one, two, ["/rosout"]).equal
    with pytest.raises(InputError, match=r"'/pos' \(did you mean '/pose'\?\)"):
        compare_recordings(one, two, ["/pos"])


def test_other_type_under_the_same_topic_is_a_difference(tmp_path):
    one = write(tmp_path / "a.mcap", {"/pose": (POSE, poses())})
    points = [
        (time, {"header": message["header"], "point": {"x": 1.0}}) for time, message in poses()
    ]
    two = write(tmp_path / "b.mcap", {"/pose": ("geometry_msgs/msg/PointStamped", points)})
    (topic,) = compare_recordings(one, two).topics
    assert topic.first_difference == f"type: {POSE} in A, geometry_msgs/msg/PointStamped in B"


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

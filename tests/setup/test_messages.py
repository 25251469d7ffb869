"""Every field of every message says its unit and its frame, and constants keep their meaning."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

MSG = Path(__file__).parents[2] / "tombo_ws" / "src" / "tombo_msgs" / "msg"
UNITS = {"s", "ns", "m", "m/s", "m/s^2", "rad", "rad/s", "N", "-"}
FRAME = re.compile(
    r"\b(map|base_link|no frame|own frame|own axis|clock of header|simulated clock)\b"
)
FIELD = re.compile(
    r"(?P<type>[\w/\[\]]+) +(?P<name>[a-z]\w*) +# \[(?P<unit>[^\]]+)\] (?P<text>.+)"
)


def lines_of(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if line and not line.startswith("#")]


@pytest.mark.parametrize("path", sorted(MSG.glob("*.msg")), ids=lambda p: p.stem)
def test_every_field_has_a_unit_and_a_frame(path: Path):
    assert path.read_text().startswith("# "), "the file begins with what the message is"
    fields = [line for line in lines_of(path) if "=" not in line.split("#")[0]]
    if not path.stem.startswith("Lockstep"):  # of the schedule, not of a measurement
        assert fields[0].startswith("std_msgs/Header header")
    for line in fields:
        field = FIELD.fullmatch(line)
        assert field, f"{path.name}: no unit and frame in: {line}"
        assert field["unit"] in UNITS, f"{path.name}: unknown unit [{field['unit']}]"
        assert FRAME.search(field["text"]), f"{path.name}: no frame in: {line}"


def test_cmake_generates_every_message():
    listed = re.findall(r"msg/(\w+)\.msg", (MSG.parent / "CMakeLists.txt").read_text())
    assert listed == sorted(path.stem for path in MSG.glob("*.msg"))


def test_phases_are_numbered_as_the_flight_modes():
    constants = re.findall(r"uint8 (\w+)=(\d+)", (MSG / "MissionStatus.msg").read_text())
    assert [(name.lower(), int(number)) for name, number in constants] == [
        ("idle", 0),
        ("takeoff", 1),
        ("hover", 2),
        ("approach", 3),
        ("react", 4),
        ("hold", 5),
        ("land", 6),
        ("landed", 7),
        ("descend_blind", 8),
    ]


def test_a_message_survives_serialization():
    from rclpy.serialization import deserialize_message, serialize_message

    from tombo_msgs.msg import CollisionEvent

    sent = CollisionEvent(trigger=CollisionEvent.TRIGGER_INNOVATION, confidence=0.9, count=2)
    sent.header.frame_id = "map"
    sent.flight_direction.x = 1.0
    assert deserialize_message(serialize_message(sent), CollisionEvent) == sent

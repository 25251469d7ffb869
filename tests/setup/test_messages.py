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

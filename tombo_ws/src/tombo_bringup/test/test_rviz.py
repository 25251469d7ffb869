"""rviz/tombo.rviz: RViz 2 loads it, and it shows topics that there are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tombo_bag.topics import TOPICS

FILE = Path(__file__).parents[4] / "tombo_ws/src/tombo_bringup/rviz/tombo.rviz"
CONFIG: dict[str, Any] = yaml.safe_load(FILE.read_text())
MANAGER = CONFIG["Visualization Manager"]
DISPLAYS: list[dict[str, Any]] = MANAGER["Displays"]

# Class of rviz_default_plugins in Jazzy -> type of the topic it shows; None: it needs none.
SHOWS = {
    "Grid": None,
    "TF": None,
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Odometry": "nav_msgs/msg/Odometry",
    "Path": "nav_msgs/msg/Path",
    "Pose": "geometry_msgs/msg/PoseStamped",
}


def plugin(entry: dict[str, Any]) -> str:
    package, _, name = entry["Class"].partition("/")
    assert package == "rviz_default_plugins"
    return name


@pytest.mark.parametrize("display", DISPLAYS, ids=lambda d: d["Name"])
def test_a_display_is_one_of_rviz_and_its_topic_is_there(display: dict[str, Any]):
    shown = SHOWS[plugin(display)]
    assert display["Enabled"] == display["Value"]
    if shown is None:
        assert "Topic" not in display
        return
    topic = display["Topic"]
    spec = TOPICS[topic["Value"]]
    assert spec.typename == shown
    assert topic["Reliability Policy"].replace(" ", "_").lower() == spec.qos.reliability
    assert topic["Durability Policy"].replace(" ", "_").lower() == spec.qos.durability
    assert topic["Depth"] == spec.qos.depth


def test_what_a_person_wants_to_see_is_shown():
    shown = {d["Topic"]["Value"] for d in DISPLAYS if "Topic" in d and d["Enabled"]}
    assert {"/markers", "/odometry", "/mocap/pose"} <= shown
    assert "TF" in {plugin(d) for d in DISPLAYS}
    assert not any(topic.startswith("/ground_truth") for topic in shown)

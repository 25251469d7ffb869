"""docs/nodes.md says what the nodes are; its tables and those of other pages hold."""

from __future__ import annotations

import re
from pathlib import Path

from tombo_bag.topics import TOPICS
from tombo_benchmarks.docs.markdown import updated
from tombo_benchmarks.docs.tables import every_node
from tombo_flight.suite.nodes import PX4_SUITE, SUITE

ROOT = Path(__file__).parents[5]
PAGE = (ROOT / "docs" / "nodes.md").read_text()
NODES = {node.name: node for node in every_node()}


def test_every_topic_has_a_line_and_a_speaker():
    for line in (line for line in PAGE.splitlines() if line.startswith("| `/")):
        speaker = line.split(" | ")[4].partition(" →")[0]
        assert set(speaker.split(", ")) <= {*SUITE, *PX4_SUITE, "all", "operator"} and speaker
    assert re.findall(r"^\| `(/[\w/]+)`", PAGE, re.M) == list(TOPICS)


def test_what_flies_does_not_listen_to_the_truth():
    for node in NODES.values():
        assert not any(topic.startswith("/ground_truth") for topic in node.subscribes)


def test_the_words_for_fault_and_loop_are_those_of_the_nodes():
    ros = ROOT / "tombo_ws/src/tombo_ros/tombo_ros"
    health = (ros / "health.py").read_text()
    assert 'values[f"fault.{key}"]' in health
    assert 'f"{self._name}: {loop}"' in health
    figures = re.findall(r'^            "(\w+)": ', (ros / "loop_statistics.py").read_text(), re.M)
    assert figures and all(f"`{name}`" in PAGE for name in figures)


def test_only_what_is_between_the_markers_changes():
    page = "a\n<!-- t -->\nold\n<!-- /t -->\nb\n"
    assert updated(page, {"t": "new\n"}) == "a\n<!-- t -->\nnew\n<!-- /t -->\nb\n"

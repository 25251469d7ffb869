"""Makes the small recorded flights of this folder: `python tests/bags/make_bags.py`.

They pin what the detector, the reaction and the mission make of a flight. If a change of their
behaviour is meant, make them again and look at what has changed with `git diff --stat`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from tombo_bag.flight_topics import write_flight
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_bag.topics import TOPICS
from tombo_dynamics.time_base import SECOND_NS
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario

HERE = Path(__file__).parent
DETECTOR = ("/mocap/pose", "/collision_event", "/ground_truth/contact")
CHAIN = (
    *DETECTOR,
    "/odometry",
    "/mission/setpoint",
    "/mission/status",
    "/setpoint",
    "/reaction/status",
)
EVERY = {"/odometry": 5, "/ground_truth/contact": 4}
"""Only every n-th message of these is kept."""

BAGS: dict[str, tuple[str, int, tuple[str, ...], tuple[str, ...]]] = {
    "paper_collision_0": ("paper_collision", 0, (), CHAIN),
    "paper_collision_7": ("paper_collision", 7, (), DETECTOR),
    "soft_strike_3": ("paper_collision", 3, ("propeller.conf=8",), DETECTOR),
    "known_obstacle_1": ("known_obstacle", 1, (), DETECTOR),
    "no_obstacle_1": ("no_obstacle", 1, (), DETECTOR),
    "aggressive_2": ("aggressive", 2, (), DETECTOR),
}
"""Name → scenario, seed, settings, topics that are kept."""


def make(name: str, target: Path) -> None:
    """Fly one of `BAGS` and keep some of its topics."""
    scenario, seed, settings, topics = BAGS[name]
    record = fly_scenario(load_scenario(scenario, settings), seed)
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "flight.mcap"
        with McapSink(whole) as sink:
            write_flight(sink, record)
        strip(whole, target, topics)


def strip(source: Path, target: Path, topics: tuple[str, ...]) -> None:
    """Copy some topics of a recording, and its metadata."""
    # one chunk: an index for each second would be larger than what it indexes
    with Recording(source) as recording, McapSink(target, chunk_span_ns=1000 * SECOND_NS) as sink:
        for name, values in recording.metadata.items():
            sink.add_metadata(name, values)
        parts = []
        for topic in topics:
            spec = TOPICS[topic]
            raw, every = recording.messages(topic), EVERY.get(topic, 1)
            channel = sink.add_channel(topic, spec.typename, spec.qos)
            parts.append(Columns(channel, raw.log_times_ns[::every], raw.messages[::every]))
        sink.write_columns(*parts)


if __name__ == "__main__":
    for bag in BAGS:
        make(bag, HERE / f"{bag}.mcap")

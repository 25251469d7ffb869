"""Recorded flights pin what detector, reaction and mission make of them, to the sample.

If this fails after a change of behaviour that is meant: `python tests/bags/make_bags.py`.
"""

import struct
from dataclasses import replace

import numpy as np
import pytest
from bag_rewrite import metadata_of, rewrite

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.recording import Recording
from tombo_dynamics.messages import CollisionEvent, neutral
from tombo_dynamics.time_base import SECOND_NS
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_metrics import TRIGGER_NAMES
from tombo_flight.flight_output import write_mcap
from tombo_flight.replay.compared import compare_streams
from tombo_flight.replay.run import ReplayRequest, replay_bag
from tombo_flight.scenario import load_scenario

EVENTS = {
    "paper_collision_0": [(23.233, "innovation", 636.12)],
    "paper_collision_7": [(23.233, "innovation", 835.4)],
    "soft_strike_3": [(23.267, "innovation", 318.32)],
    "known_obstacle_1": [(23.033, "region", 1.9)],
    "no_obstacle_1": [],
    "aggressive_2": [],
}
"""Bag → capture time [s] of the pose that triggered, trigger, statistic."""


def flight_time(event):
    return round((event.stamp_ns - 1_000_000_000) / 1e9, 3)


@pytest.mark.parametrize("bag", EVENTS)
def test_the_detector_says_the_same_events_to_the_sample(replayed, bag):
    result = replayed(bag, nodes=("detector",))
    _, events = result.published["/collision_event"]
    found = [(flight_time(e), TRIGGER_NAMES[e.trigger], round(e.statistic, 2)) for e in events]
    assert found == EVENTS[bag]
    metrics = result.nodes["detector"].values
    assert metrics["matched"] == len(EVENTS[bag])
    assert (metrics["missed"], metrics["extra"], metrics["false_alarms"]) == (0, 0, 0)
    assert metrics["detection_time_difference_ms"] == [0.0] * len(EVENTS[bag])
    assert all(error < 1e-9 for error in metrics["x_c_error_m"])
    assert all(-1.0 <= ms <= 0.0 for ms in metrics["known_time_difference_ms"])
    assert result.differences == []
    assert result.damage == []


@pytest.mark.parametrize(
    ("setting", "missed", "extra"),
    [
        ("detector.threshold=2000", 1, 0),
        ("detector.threshold=5", 0, 2),
        ("detector.trigger=none", 1, 0),
        ("detector.arm_height=5.0", 1, 0),
    ],
)
def test_another_detector_is_seen_to_be_one(replayed, setting, missed, extra):
    result = replayed("paper_collision_0", setting, nodes=("detector",))
    metrics = result.nodes["detector"].values
    assert (metrics["missed"], metrics["extra"]) == (missed, extra)
    assert len(result.differences) == (missed > 0) + (extra > 0)


def test_false_alarms_are_counted_against_the_true_contact(replayed):
    result = replayed("no_obstacle_1", "detector.threshold=4", nodes=("detector",))
    metrics = result.nodes["detector"].values
    assert metrics["false_alarms"] == metrics["extra"] > 2
    true = replayed("paper_collision_0", nodes=("detector",)).nodes["detector"].values
    assert 10.0 < true["latency_ms"][0] < 60.0


@pytest.mark.slow
def test_a_headless_flight_is_replayed_to_the_last_bit(short_flight):
    result = replay_bag(short_flight, ReplayRequest())
    assert set(result.nodes) == {"detector", "mission", "reaction", "estimator", "controller"}
    series = (one for node in result.nodes.values() for one in node.values.values())
    compared = [one for one in series if isinstance(one, dict) and "compared" in one]
    assert [one for one in compared if one.get("differing", 0)] == []  # of filterpy's
    compared = [one for one in compared if "differing" not in one]
    assert len(compared) == 7
    for one in compared:
        assert one["compared"] > 300
        largest = next(value for key, value in one.items() if key.startswith("max"))
        assert largest < (1e-7 if "max_rad" in one else 1e-300)  # an angle of a cosine next to 1
    assert result.nodes["mission"].values["phase_time_difference_ms"] == 6 * [0.0]


@pytest.fixture(scope="module")
def short_flight(tmp_path_factory):
    """A collision of 16 s with its statistic."""
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    short = ["mission.takeoff_time=0.1", "mission.approach_time=5.0", "duration=16.0"]
    write_mcap(fly_scenario(load_scenario(settings=short), 3), path)
    return path


@pytest.mark.slow
def test_a_statistic_that_is_not_the_filters_is_a_finding(short_flight, tmp_path):
    """Values that are off by 1e-8 are below the tolerances of the replay."""

    def off(topic, messages):
        if topic != "/detector/status":
            return messages
        value = struct.Struct("<d")
        at = len(messages[0]) - 24  # statistic, threshold, two counts
        return [
            m[:at] + value.pack(value.unpack_from(m, at)[0] * (1.0 + 1e-8)) + m[at + 8 :]
            for m in messages
        ]

    with Recording(short_flight) as recording:
        metadata = dict(recording.metadata[FLIGHT_METADATA])
    path = rewrite(short_flight, tmp_path / "off.mcap", metadata=metadata, edit=off)
    result = replay_bag(path, ReplayRequest(nodes=("detector",)))
    (line,) = [line for line in result.findings if "filterpy" in line]
    assert f"of {result.nodes['detector'].values['filterpy']['compared']} poses" in line
    assert result.nodes["detector"].values["filterpy"]["differing"] > 200
    assert result.differences == []


@pytest.mark.slow
def test_a_reaction_without_recorded_events_gets_the_replayed_detectors(short_flight, tmp_path):
    def without_events(topic, count):
        return np.full(count, topic != "/collision_event")

    path = rewrite(
        short_flight,
        tmp_path / "old.mcap",
        metadata=metadata_of(short_flight),
        keep=without_events,
    )
    result = replay_bag(path, ReplayRequest(nodes=("reaction",)))
    assert any("it gets the replayed detector's" in line for line in result.findings)
    reaction = result.nodes["reaction"].values
    assert reaction["switches_replayed"] == reaction["switches_recorded"] == 1
    assert reaction["setpoint"]["max_m"] < 1e-9


@pytest.mark.slow
def test_reaction_and_mission_do_again_what_they_did(replayed):
    result = replayed("paper_collision_0")
    reaction, mission = (result.nodes[name].values for name in ("reaction", "mission"))
    assert reaction["setpoint"]["max_m"] < 1e-9
    assert reaction["setpoint"]["compared"] > 1900
    assert reaction["switches_recorded"] == reaction["switches_replayed"] == 1
    assert reaction["x_r_error_m"] == [pytest.approx(0.0, abs=1e-9)]
    assert abs(reaction["switch_time_difference_ms"][0]) <= 20.0
    assert mission["phases_replayed"] == [
        "idle", "takeoff", "hover", "approach", "react", "hold", "land", "landed",
    ]  # fmt: skip
    assert max(map(abs, mission["phase_time_difference_ms"])) < 60.0
    assert mission["setpoint"]["rms_m"] < 0.01
    assert result.differences == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("reaction.distance=1.0", "reaction: set point differs"),
        ("mission.approach_speed=0.9", "mission: set point differs"),
        ("mission.hold_time=60.0", "mission: phases idle, takeoff, hover, approach, react, hold"),
    ],
)
def test_another_reaction_or_mission_is_seen_to_be_one(replayed, setting, words):
    node = setting.partition(".")[0]
    result = replayed("paper_collision_0", setting, nodes=(node,))
    assert any(line.startswith(words) for line in result.differences), result.differences


def test_what_can_not_be_replayed_is_said_with_the_missing_topics(replayed):
    result = replayed("paper_collision_7")
    assert list(result.nodes) == ["detector"]
    lines = [line for line in result.findings if "can't be replayed" in line]
    assert len(lines) == 4
    assert "mission can't be replayed: no /odometry in the bag" in lines


def test_differences_are_replayed_minus_recorded():
    """The replay sees the collision 20 ms later and 3 mm farther; it is known 30 ms later."""
    seen = neutral(CollisionEvent, 5 * SECOND_NS)
    later = replace(
        seen,
        stamp_ns=seen.stamp_ns + 20_000_000,
        contact_position=seen.contact_position + np.array([0.003, 0.0, 0.0]),
    )
    recorded, replayed = (
        {"/collision_event": (np.array([known_ns]), [event])}
        for known_ns, event in ((seen.stamp_ns, seen), (seen.stamp_ns + 30_000_000, later))
    )
    found = compare_streams("detector", recorded, replayed, 0, None)
    assert found.values["detection_time_difference_ms"] == [20.0]
    assert found.values["known_time_difference_ms"] == [30.0]
    assert found.differences == ["detection differs by 20.000 ms", "x_c differs by 3.000 mm"]

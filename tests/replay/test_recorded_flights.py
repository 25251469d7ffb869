"""Recorded flights pin what detector, reaction and mission make of them, to the sample.

If this fails after a change of behaviour that is meant: `python tests/bags/make_bags.py`.
"""

import struct

import numpy as np
import pytest
from bag_rewrite import rewrite
from mcap.reader import make_reader
from mcap.writer import Writer

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.recording import Recording
from tombo_collision.detector_core import DetectorCore
from tombo_collision.params import DetectorParams
from tombo_dynamics.messages import Pose
from tombo_dynamics.time_base import SECOND_NS
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import write_mcap
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
    found = [
        (flight_time(e), e.trigger, round(e.message.statistic, 2)) for e in result.replayed.events
    ]
    assert found == EVENTS[bag]
    metrics = result.nodes["detector"]
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
    metrics = result.nodes["detector"]
    assert (metrics["missed"], metrics["extra"]) == (missed, extra)
    assert len(result.differences) == (missed > 0) + (extra > 0)


def test_false_alarms_are_counted_against_the_true_contact(replayed):
    result = replayed("no_obstacle_1", "detector.threshold=4", nodes=("detector",))
    metrics = result.nodes["detector"]
    assert metrics["false_alarms"] == metrics["extra"] > 2
    true = replayed("paper_collision_0", nodes=("detector",)).nodes["detector"]
    assert 10.0 < true["latency_ms"][0] < 60.0


@pytest.mark.slow
def test_a_headless_flight_is_replayed_to_the_last_bit(short_flight):
    result = replay_bag(short_flight, ReplayRequest())
    assert set(result.nodes) == {"detector", "mission", "reaction", "estimator", "controller"}
    series = (one for node in result.nodes.values() for one in node.values())
    compared = [one for one in series if isinstance(one, dict) and "compared" in one]
    confirmed = [one for one in compared if "differing" in one]  # by filterpy
    assert [one["differing"] for one in confirmed] == [0]
    compared = [one for one in compared if "differing" not in one]
    assert len(compared) == 7
    for one in compared:
        assert one["compared"] > 300
        largest = next(value for key, value in one.items() if key.startswith("max"))
        assert largest < (1e-7 if "max_rad" in one else 1e-300)  # an angle of a cosine next to 1
    assert result.nodes["mission"]["phase_time_difference_ms"] == 6 * [0.0]


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
    assert f"of {result.nodes['detector']['filterpy']['compared']} poses" in line
    assert result.nodes["detector"]["filterpy"]["differing"] > 200
    assert result.differences == []


def without_beginning(source, target, seconds):
    """Write a recording that begins later."""
    with source.open("rb") as file, target.open("wb") as out:
        reader, writer = make_reader(file), Writer(out)
        writer.start()
        first = reader.get_summary().statistics.message_start_time
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        channels = {}
        for schema, channel, message in reader.iter_messages(
            starting_at=first + round(seconds * SECOND_NS)
        ):
            if channel.topic not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, known, channel.metadata
                )
            number, times = channels[channel.topic], (message.log_time, message.publish_time)
            writer.add_message(number, times[0], message.data, times[1], message.sequence)
        writer.finish()


def collisions(track, by_s=0.0, from_ns=1 << 62):
    """Arrival [s] of each collision's pose, where clocks were set by `by_s` in flight."""
    core, found = DetectorCore(DetectorParams()), []
    rows = zip(
        *(track.stamp_ns.tolist(), track.arrival_ns.tolist(), track.frame.tolist()),
        *(track.position, track.attitude),
        strict=True,
    )
    for stamp_ns, arrival_ns, frame, position, attitude in rows:
        by_ns = round(by_s * SECOND_NS) if stamp_ns >= from_ns else 0
        now_ns = arrival_ns + by_ns
        core.on("/mocap/pose", Pose(stamp_ns + by_ns, frame, position, attitude), now_ns)
        published = core.step(now_ns)
        found += [1e-9 * arrival_ns for topic, _ in published if topic == "/collision_event"]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("by_s", [2.0, -2.0, 0.15])
def test_a_clock_that_is_set_blinds_for_a_fifth_of_a_second(poses, by_s):
    track = poses("paper_collision_0")
    (known_s,) = collisions(track)
    stamps_s = 1e-9 * track.stamp_ns
    for row in np.flatnonzero((stamps_s > known_s - 0.6) & (stamps_s < known_s + 0.05)):
        first_s, *_ = collisions(track, by_s, int(track.stamp_ns[row]))
        assert known_s - 1e-6 < first_s < known_s + 0.2


@pytest.mark.slow
@pytest.mark.parametrize("by_s", [2.0, -2.0, 0.15])
def test_a_clock_that_is_set_is_no_collision(poses, by_s):
    track = poses("no_obstacle_1")
    for row in range(60, len(track.stamp_ns), 40):
        assert collisions(track, by_s, int(track.stamp_ns[row])) == []


@pytest.mark.slow
def test_a_recording_begun_in_flight_moves_the_controller(short_flight, tmp_path):
    without_beginning(short_flight, tmp_path / "flight.mcap", 6.0)
    controller = replay_bag(tmp_path / "flight.mcap", ReplayRequest(nodes=("controller",))).nodes
    speed = controller["controller"]["rotor_command"]
    assert speed["compared"] == 10_000
    assert 0.0 < speed["rms_rad_s"] < 60.0, "its integrators begin anew, but it flies"


@pytest.mark.slow
def test_reaction_and_mission_do_again_what_they_did(replayed):
    result = replayed("paper_collision_0")
    reaction, mission = result.nodes["reaction"], result.nodes["mission"]
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

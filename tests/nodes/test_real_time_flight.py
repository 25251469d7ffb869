"""The paper's experiment flown by the nodes in real time, with all files of a headless flight."""

from __future__ import annotations

import pytest

from in_time import in_time
from tombo_bag.formats.reader import Bag
from tombo_bag.recording import Recording
from tombo_bag.topics import CLOCK, GOAL_POSE, PX4_STATUS, TF, TOPICS
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario

pytestmark = pytest.mark.real_time

pytest.importorskip("rclpy")

SHORT = ("mission.approach_time=5.0", "mission.hold_time=1.0", "mission.land_speed=0.7")
"""The way to the obstacle begins as soon as the vehicle hovers."""
FLIGHT = ("--nodes", *(word for setting in SHORT for word in ("--set", setting)))


def test_the_vehicle_recovers_as_in_the_headless_flight(flight_run):
    _, figures = flight_run
    headless = fly_scenario(load_scenario(settings=SHORT), 0).summary
    assert headless["collided"] and headless["landed"] and not headless["crashed"]
    with in_time():  # a vehicle whose controller is late flies another flight
        assert figures["collided"] and figures["landed"] and not figures["crashed"]
        assert figures["detections"] == 1 and figures["false_alarms"] == 0
        assert figures["contact_rotor"] == headless["contact_rotor"] == "front_left"
        # no two node flights are equal: bands are those of 40 seeds of the headless one, and more
        assert figures["collision_time_s"] == pytest.approx(headless["collision_time_s"], abs=1.5)
        assert 0.02 < figures["max_falling_distance_m"] < 0.95
        assert 2.0 < figures["recovery_time_s"] < 7.0
        assert figures["settled_error_m"] < 0.15
        assert figures["hover_rms_m"] < 0.08
        for loop, rate_hz in (("position", 50.0), ("attitude", 250.0), ("rate", 1000.0)):
            assert figures["loops"][loop]["rate_hz"] == pytest.approx(rate_hz, rel=0.2)
        assert figures["latency_gyro_to_command_us"]["p50"] < 5_000.0


def test_it_says_how_it_was_flown(flight_run):
    _, figures = flight_run
    assert figures["mode"] == "nodes"
    for loop in ("position", "attitude", "rate"):
        assert {"jitter_p50_us", "jitter_p99_us", "missed"} <= set(figures["loops"][loop])
    assert figures["latency_gyro_to_command_us"]["p50"] > 0.0
    assert figures["recorder"]["messages"] > 10_000
    assert figures["died"] == {}


def test_it_leaves_the_same_files(flight_run):
    folder, figures = flight_run
    names = {path.name for path in folder.iterdir()}
    assert names == {"flight.mcap", "flight.png", "report.html", "scenario.yaml", "summary.json"}
    bag = Bag(folder / "flight.mcap", check=True)
    assert not bag.damage
    assert set(bag.topics) >= set(TOPICS) - {CLOCK.name, GOAL_POSE.name, PX4_STATUS.name}
    with Recording(folder / "flight.mcap") as recording:
        transforms = recording.columns(TF.name)
    assert set(transforms["transforms[0].child_frame_id"]) == {"odom"}
    assert sum(topic.count for topic in bag.topics.values()) == figures["recorded_messages"]

"""Courses flown headless: the vehicle's path and heading, and accepted courses."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

from tombo_control.planning.course import leg_to, resolved_waypoint, waypoint_table
from tombo_control.planning.leg import motion_end
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase
from tombo_dynamics.yaml_text import parse_yaml
from tombo_flight.flight import as_flown, fly_scenario
from tombo_flight.flight_output import complete_mapping
from tombo_flight.replay.cores import scenario_of_bag
from tombo_flight.scenario import extended_scenario, load_scenario, scenario_from_mapping, world_of
from tombo_flight.yaml_file import yaml_of
from tombo_sim.flight_setup import begin

COURSE = [
    {"x": 1.5, "yaw": 1.57, "speed": 1.0, "hold": 2.5},
    {"x": -1.0, "y": 1.0, "yaw": -1.57, "speed": 1.5, "acceleration": 1.5},
    {"x": 0.0, "z": 2.0, "speed": 0.7},
]


def scenario_with(course=COURSE, **mission):
    mission = {"height": 1.2, "climb_speed": 0.9, "approach_time": 4.0, **mission}
    return extended_scenario(
        {"extends": "no_obstacle", "mission": {**mission, "course": course}}, "test"
    )


def yaw_of(record):
    x, y, z, w = record.log["attitude"].T
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def ends(scenario, begun):
    """(time, target) at the end of each hold, for a course begun at a time."""
    here, yaw, now = (0.0, 0.0, scenario.mission.height), 0.0, begun
    hover, table = here, waypoint_table(scenario.mission.course)
    for row in range(len(table)):
        target = resolved_waypoint(table, row, hover, scenario.mission.approach_speed)
        leg = leg_to(target, here, yaw, now)
        now = motion_end(leg) + leg.hold_s
        here, yaw = target[:3], target.yaw
        yield now, target


def began(record, kind):
    return next(float(e["time_s"]) for e in record.events if e["kind"] == kind)


def test_each_waypoint_is_reached_with_its_heading_before_landing():
    scenario = scenario_with()
    record = fly_scenario(scenario, 3)
    assert record.summary["landed"] and not record.summary["crashed"]
    heading = yaw_of(record)
    for now, target in ends(scenario, began(record, "approach")):
        at = round(now * 1000) - 20
        assert record.log["position"][at] == pytest.approx(target[:3], abs=0.08)
        assert math.remainder(heading[at] - target.yaw, 2.0 * math.pi) == pytest.approx(0, abs=0.1)
    assert began(record, "land") == pytest.approx(now, abs=0.1)
    assert record.t[-1] < now + 12.0


def test_what_was_recorded_is_the_same_course_again():
    scenario = scenario_with()
    flown = as_flown(scenario, 0, begin(world_of(scenario), 0))
    text = json.dumps(flown, sort_keys=True)
    again, findings = scenario_of_bag({"tombo_flight": {"scenario": text}})
    assert findings == []
    assert again.mission == scenario.mission


def test_a_course_over_a_course_replaces_it_and_null_takes_it_away():
    fewer = extended_scenario({"extends": "survey", "mission": {"course": COURSE[:1]}}, "a")
    assert len(fewer.mission.course) == 1
    none = extended_scenario({"extends": "survey", "mission": {"course": None}}, "b")
    assert none.mission.course is None
    assert load_scenario("survey", ["mission.course=[{x: 1}]"]).mission.course[0].x == 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"course": []}, "mission.course: 0 waypoints"),
        ({"course": [{}, {}, {}, {"speed": -1.0}]}, r"mission.course\[3\].speed: -1.0"),
        ({"course": [{"x": float("nan")}]}, r"mission.course\[0\].x: nan"),
        ({"course": "survey"}, "mission.course: 'survey' can't be read"),
        ({"step_size": 1.0}, "mission.course and mission.step_size 1"),
        ({"land_time": 10.0}, "mission.course: lasts until .*land_time, 10 .*approach_time"),
        (
            {"course": [{}, {"x": 3, "speed": 3, "acceleration": 6}]},
            r"course\[1\].speed: 3.00 m/s",
        ),
        ({"course": [{"z": 3, "speed": 2, "acceleration": 6}]}, "up or down.*velocity_max_z, 1"),
    ],
)
def test_a_course_that_can_t_be_flown_as_written_is_refused(changes, words):
    with pytest.raises(InputError, match=words) as caught:
        scenario_with(**{"course": COURSE, **changes})
    assert "\n" not in str(caught.value)


class TestSurvey:
    """The flight that a lab is told to fly."""

    @pytest.fixture(scope="class")
    def record(self):
        return fly_scenario(load_scenario("survey"), 1)

    def test_stays_in_its_room_and_ends_by_itself(self, record):
        place = record.log["position"]
        assert np.abs(place[:, :2]).max() < 2.0
        assert place[:, 2].max() < 3.0
        assert record.summary["landed"] and not record.summary["false_alarms"]
        assert record.t[-1] < 50.0  # 42 s, and one wait or two for a waypoint to be reached
        flying = record.log["mode"][:, 0] == Phase.APPROACH
        assert place[flying, 2].min() > 0.25

    def test_has_what_tells_causes_apart(self, record):
        flying = record.log["mode"][:, 0] == Phase.APPROACH
        velocity = record.log["velocity"][flying]
        place = record.log["position"][flying]
        speed = np.linalg.norm(velocity, axis=1)
        level = np.abs(velocity[:, 2]) < 0.1
        for slow, fast in ((0.6, 0.8), (1.3, 1.5), (2.3, 2.6)):
            there = (speed > slow) & (speed < fast) & level
            assert (velocity[there, 0] > 0.5).sum() > 200  # both ways
            assert (velocity[there, 0] < -0.5).sum() > 200
        assert (place[:, 2] < 0.45).mean() > 0.05
        assert place[:, 2].max() > 2.0
        yaw = np.unwrap(yaw_of(record)[flying])
        assert np.ptp(yaw) > 3.0
        still = (speed < 0.2) & (np.abs(record.log["rates"][flying, 2]) > 0.5)
        assert still.sum() > 500  # a turn in hover
        assert np.abs(record.log["rates"][flying, :2]).max(axis=0).min() > 2.0  # quick tilts
        assert np.abs(record.log["rates"][flying, 2]).max() > 1.2


def test_a_course_of_a_file_is_flown_along_and_flies_again_from_its_scenario_file():
    scenario = load_scenario("figure_eight")
    record = fly_scenario(scenario, 3)
    assert record.summary["landed"]
    assert record.summary["approach_rms_m"] < 0.1
    crossing = record.log["position"][record.log["mode"][:, 0] == Phase.APPROACH]
    assert np.ptp(crossing, axis=0) == pytest.approx([2.4, 1.2, 0.3], abs=0.1)
    again = scenario_from_mapping(parse_yaml(yaml_of(complete_mapping(scenario)), "it"), "again")
    assert again.mission == scenario.mission


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("control.velocity_max_xy=0.5", "speed 0.5"),
        ("control.tilt_max=0.06", "tilt 0.06"),
        ("volume.x_max=1.0", "m outside of the flight volume"),
        ("control.velocity_max_z=0.1", "speed 0.10 m/s up or down"),
        ("mission.land_time=30", "lasts until"),
        ("mission.course=nowhere.csv", "nowhere.csv"),
    ],
)
def test_a_course_of_a_file_beyond_a_limit_is_refused_by_row_and_time(setting, named):
    with pytest.raises(InputError, match=r"mission\.course") as error:
        load_scenario("figure_eight", [setting])
    assert named in str(error.value) and "accepted: " in str(error.value)
    if setting.startswith(("control", "volume")):
        assert re.search(r"row \d+, at \d+\.\d\d s: ", str(error.value))

from dataclasses import replace

import numpy as np
import pytest

from tombo_flight.report.figures import FlightOutcome, find_milestones, roll_pitch_yaw_deg


def test_tells_the_recovery_in_the_papers_words(flight):
    milestones = find_milestones(flight)
    assert milestones.verdict is FlightOutcome.RECOVERED
    contact_s = milestones.contact_s
    assert contact_s == flight.summary["collision_time_s"]
    assert milestones.unstable_end_s - contact_s == pytest.approx(0.97, abs=0.1)
    assert milestones.recovery_end_s - contact_s == pytest.approx(5.3, abs=0.1)
    assert milestones.x_c_m == pytest.approx((1.7, 0.0, 2.0), abs=0.05)
    assert 0.0 < milestones.detection_s - contact_s < 0.06


@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("no contact", FlightOutcome.NO_CONTACT),
        ("crashed", FlightOutcome.CRASHED),
        ("cut short at 0.3 s", FlightOutcome.NO_CONTACT),
    ],
)
def test_verdict(edge_flights, name, verdict):
    assert find_milestones(edge_flights[name]).verdict is verdict


def test_a_false_alarm_is_not_the_detection_of_the_contact(flight):
    alarm = {"time_s": 12.0, "kind": "detection", "text": "false"}
    switch = {"time_s": 12.02, "kind": "setpoint_switch", "text": "false"}
    milestones = find_milestones(replace(flight, events=[alarm, switch, *flight.events]))
    assert milestones == find_milestones(flight)


def test_angles_are_right_and_break_where_they_jump():
    yaw_deg = np.linspace(0.0, 720.0, 201)
    half = np.radians(yaw_deg) / 2.0
    spin = np.stack((0 * half, 0 * half, np.sin(half), np.cos(half)), axis=1)
    seen = roll_pitch_yaw_deg(spin)[:, 2]
    broken = np.isnan(seen)
    assert broken.sum() == 2
    off = (seen - yaw_deg + 180.0) % 360.0 - 180.0
    assert np.abs(off[~broken]).max() < 1e-6
    rolled = np.array([[np.sin(np.radians(15.0)), 0.0, 0.0, np.cos(np.radians(15.0))]])
    assert roll_pitch_yaw_deg(rolled)[0] == pytest.approx([30.0, 0.0, 0.0])

"""Scales and offsets of single axes, lost samples, late commands: said, with their size."""

import numpy as np
import pytest
from made_flight import made_flight, with_values, wrote

from tombo_bag.flight import Series
from tombo_logs.checks import check_log

FLIGHT = made_flight()


@pytest.mark.parametrize(
    ("channel", "change", "check", "text"),
    [
        ("gyro", lambda w: w * [1.4, 1, 1], "scale", "gyro: its x moves"),
        ("gyro", lambda w: w + np.array([0, 0, 0.2]), "offset", "its z reads +0.2"),
        ("accel", lambda a: a * [1, 1, 1.1], "offset", "times the force"),
        ("accel", lambda a: a - [0, 1.2, 0], "offset", "its y reads -1.2"),
        ("position", lambda p: p * [1, 1.4, 1], "scale", "position: its y moves"),
        ("rotor_command", lambda u: u * [1, 1, 0.85, 1], "scale", "front_left is asked for 0.7"),
    ],
)
def test_an_axis_is_named_with_its_size(channel, change, check, text):
    found = [
        f for f in check_log(with_values(FLIGHT, channel, change)).findings if f.check == check
    ]
    assert [(f.channel, f.severity) for f in found] == [(channel, "warning")]
    assert text in found[0].message


def test_samples_that_are_lost_one_by_one():
    kept = np.random.default_rng(3).random(FLIGHT.series["gyro"].t.size) > 0.15
    gyro = FLIGHT.series["gyro"]
    log = FLIGHT.with_series({**FLIGHT.series, "gyro": Series(gyro.t[kept], gyro.values[kept])})
    (text,) = [f.message for f in wrote(check_log(log), "are lost") if f.severity == "warning"]
    assert "gyro: 15 %" in text or "gyro: 14 %" in text or "gyro: 16 %" in text


@pytest.mark.parametrize("late", [0.12, -0.25])
def test_commands_that_come_after_what_they_do(late):
    drive = FLIGHT.series["rotor_command"]
    log = FLIGHT.with_series(
        {**FLIGHT.series, "rotor_command": Series(drive.t + late, drive.values)}
    )
    (text,) = [f.message for f in check_log(log).findings if f.check == "stamps"]
    assert ("before" if late > 0 else "after") in text

"""Scales and offsets of single axes: said, with their size."""

import pytest
from made_flight import made_flight, with_values

from tombo_logs.checks import check_log

FLIGHT = made_flight()


@pytest.mark.parametrize(
    ("channel", "change", "check", "text"),
    [
        ("gyro", lambda w: w * [1.4, 1, 1], "scale", "gyro: its x moves"),
        ("gyro", lambda w: w - [0, 0, -0.2], "offset", "its z reads +0.2"),
        ("accel", lambda a: a * [1, 1, 1.1], "offset", "its z reads +1."),
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

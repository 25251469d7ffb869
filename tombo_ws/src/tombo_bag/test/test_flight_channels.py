"""Channels of a flight: short names for fields of its topics."""

from dataclasses import fields

import numpy as np
import pytest

from tombo_bag.channels import CHANNELS
from tombo_bag.flight import Flight, Series
from tombo_bag.message_codec import FORMS
from tombo_bag.topics import TOPICS
from tombo_dynamics.errors import InputError

T = np.arange(5) * 0.01


def channel(name, t=T):
    return Series(t, np.full((t.size, CHANNELS[name].width), 1.5))


def test_every_channel_comes_back_by_its_name_from_the_topic_that_it_names():
    given = {name: channel(name) for name in CHANNELS}
    flight = Flight.measured("a", "made", given)
    assert flight.series.keys() == given.keys()
    assert all(flight.series[name] is given[name] for name in given)
    assert flight["/imu/data_raw"]["gyro"] is given["gyro"]
    with pytest.raises(InputError, match="mag"):
        flight["/imu/data_raw"]["mag"]


def test_channels_of_the_suites_messages_have_the_units_and_widths_of_their_fields():
    held = {
        name: one.metadata
        for name, channel in CHANNELS.items()
        if channel.topic in TOPICS and TOPICS[channel.topic].typename in FORMS
        for one in fields(FORMS[TOPICS[channel.topic].typename])
        if one.name == channel.field
    }
    assert set(held) == {"position", "attitude", "gyro", "accel", "rotor_command"}
    for name, metadata in held.items():
        assert (metadata["unit"], metadata["length"]) == (
            CHANNELS[name].unit,
            CHANNELS[name].width,
        )


def test_other_channels_replace_all_that_were_there():
    flight = Flight.measured("a", "made", {"gyro": channel("gyro"), "voltage": channel("voltage")})
    again = flight.with_series({"gyro": flight.series["gyro"]})
    assert set(again.series) == {"gyro"} and again.name == "a" and "voltage" in flight.series


def test_its_length_is_that_of_all_channels_and_speeds_may_be_asked_for():
    late = channel("rotor_command", T + 1.0)
    flight = Flight.measured("a", "made", {"gyro": channel("gyro"), "rotor_command": late})
    assert flight.duration_s == pytest.approx(1.04) and flight.has_rotor_speeds
    assert Flight({}).duration_s == 0.0 and not Flight({}).has_rotor_speeds

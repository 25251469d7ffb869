"""The verdict of flights in words."""

import math

from tombo_diagnosis.flight.summary_text import gain_sentence
from tombo_flight.extended_model import Gain

FORCE = Gain("force z", "m/s^2", "one step", 0.155, 0.042, 0.73, 0.72, 0.73, 3)
VOLTAGE = Gain("voltage", "V", "one step", 1e-4, 4e-7, 0.996, -99.7, 1.0, 3)


def test_a_larger_gain_that_may_be_none_is_not_the_one_told():
    assert "force z falls from 0.155 to 0.042" in gain_sentence([VOLTAGE, FORCE])
    assert gain_sentence([VOLTAGE]) == ""


def test_a_gain_of_too_few_flights_for_an_interval_is_told():
    single = Gain("force z", "m/s^2", "one step", 0.155, 0.042, 0.73, math.nan, math.nan, 1)
    assert "force z" in gain_sentence([single])

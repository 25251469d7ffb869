"""Texts of a diagnosis of flights: its gain, and its limits."""

from tombo_diagnosis.flight.summary_text import gain_sentence
from tombo_flight.extended_model import Gain


def test_a_larger_gain_that_may_be_none_is_not_the_one_told():
    force = Gain("force z", "m/s^2", "one step", 0.155, 0.042, 0.73, 0.72, 0.73, 3)
    voltage = Gain("voltage", "V", "one step", 1e-4, 4e-7, 0.996, -99.7, 1.0, 3)
    assert "force z falls from 0.155 to 0.042" in gain_sentence([voltage, force])
    assert gain_sentence([voltage]) == ""

"""What a diagnosis of flights says: its gain, and its limits."""

from types import SimpleNamespace

import pytest

from tombo_diagnosis.flight.summary_text import gain_sentence, notes
from tombo_flight.extended_model import Gain

LOG, OTHER = SimpleNamespace(name="one"), SimpleNamespace(name="two")


def notes_of(logs, vehicles=1):
    """Return the notes for tracks of these logs; a log given twice is one flight in two parts."""
    nominal = SimpleNamespace(calibrated=False, moments=True)
    tracks = [SimpleNamespace(log=log, formulation="imu") for log in logs]
    problem = SimpleNamespace(tracks=tracks, nominal=nominal, vehicles=vehicles)
    return notes(SimpleNamespace(problem=problem))


@pytest.mark.parametrize(
    ("logs", "counted"),
    [([LOG], "1 flight:"), ([LOG, LOG], "1 flight, in 2 parts:"), ([LOG, OTHER], "2 flights:")],
)
def test_parts_of_a_flight_are_not_counted_as_flights(logs, counted):
    (note,) = notes_of(logs)
    assert note.startswith(counted)


def test_a_larger_gain_that_may_be_none_is_not_the_one_told():
    force = Gain("force z", "m/s^2", "one step", 0.155, 0.042, 0.73, 0.72, 0.73, 3)
    voltage = Gain("voltage", "V", "one step", 1e-4, 4e-7, 0.996, -99.7, 1.0, 3)
    assert "force z falls from 0.155 to 0.042" in gain_sentence([voltage, force])
    assert gain_sentence([voltage]) == ""

"""What lasts a moment is set apart and said; what lasts is not."""

from functools import partial

import measured_flights
import numpy as np
import pytest
from measured_flights import nominal

from tombo_bag.flight import Series
from tombo_diagnosis.flight.analyse import analyse
from tombo_diagnosis.flight.diagnose import diagnose_flights
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.fit.transients import find_transients

pytestmark = pytest.mark.slow

LENGTH = 22.0
"""s: a knock is a moment of it."""
logs, tracks = (
    partial(fly, length=LENGTH) for fly in (measured_flights.logs, measured_flights.tracks)
)
KNOCK_S = 9.0
HEAVY = {"mass_error": {"fraction": 0.1}}


def knocked(log, times=(KNOCK_S,)):
    """Return a flight in which the vehicle was hit for 60 ms, as its accelerometer saw it."""
    series = log.series["accel"]
    values = series.values.copy()
    for time in times:
        values[(series.t > time) & (series.t < time + 0.06)] += (30.0, -20.0, 10.0)
    return log.with_series({**log.series, "accel": Series(series.t, values)})


def test_a_cause_is_named_through_a_knock_that_is_reported():
    first, second = logs(HEAVY, sensors="imu")
    diagnosis = diagnose_flights([knocked(first), second], nominal())[0]
    assert diagnosis.verdict == "named" and [c.effect for c in diagnosis.causes] == ["mass_error"]
    (moment,) = [f for f in diagnosis.prechecks if f.check == "moment"]
    assert moment.flight == first.name and moment.start_s < KNOCK_S < moment.end_s
    assert moment.end_s - moment.start_s < 2.0


def test_a_healthy_flight_with_a_knock_has_no_cause():
    first, second = logs(sensors="imu")
    result = analyse([track_of(knocked(first)), track_of(second)], nominal())
    assert result.judgement.verdict == "none"
    (excluded,) = result.remainder.excluded
    assert excluded.flight == first.name


@pytest.mark.parametrize("sensors", ["imu_rpm", "mocap"])
def test_quiet_flights_have_no_moments(sensors):
    problem = FlightProblem(tracks(sensors=sensors), nominal())
    assert find_transients(problem, problem.null_hypothesis) == []


def test_knocks_all_the_time_are_an_unknown_cause():
    times = np.arange(4.0, LENGTH - 2.0, 1.0)
    result = analyse([track_of(knocked(log, times)) for log in logs(sensors="imu")], nominal())
    assert result.remainder.excluded == () and result.judgement.verdict == "unknown"

"""Wind of new flights is named with its speed, or withheld; never another cause."""

import numpy as np
import pytest
from measured_flights import LIVELY, logs, nominal

from tombo_diagnosis.change.diagnose import NEEDED, diagnose_change
from tombo_diagnosis.flight.diagnose import check_flights

pytestmark = pytest.mark.slow
SPEED = 6.0


def checked(hidden, seed, count):
    return check_flights(logs(hidden, seed=seed, count=count, courses=LIVELY), needed=NEEDED)[0]


def wind(east, north):
    return {"steady_wind": {"east": east, "north": north}}


@pytest.fixture(scope="module")
def calm():
    return checked(None, 1, 3)


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_wind_is_named_with_its_speed(calm, heading):
    blown = checked(wind(SPEED * np.cos(heading), SPEED * np.sin(heading)), 7, 2)
    result = diagnose_change(blown, calm, nominal(), sessions={"*": "today"})[0]
    assert result.verdict == "named"
    (change,) = result.changed
    assert change.effect == "steady_wind"
    speed = [p.value for p in change.theta]
    assert speed == pytest.approx([SPEED * np.cos(heading), SPEED * np.sin(heading)], abs=1.5)
    assert np.linalg.norm(speed) == pytest.approx(SPEED, rel=0.2)
    assert all(p.low < p.value < p.high for p in change.theta)


def test_the_same_wind_before_and_now_is_no_change():
    before, now = (checked(wind(SPEED, 0.0), seed, 2) for seed in (2, 8))
    result = diagnose_change(now, before, nominal(), sessions={"*": "today"})[0]
    assert result.verdict == "none" and not result.changed

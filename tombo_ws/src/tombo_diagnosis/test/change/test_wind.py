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


TRIM = {"mocap_body_misalignment": {"pitch": 0.087}, "quadratic_body_drag": {"c_area": 0.05}}
"""A body that was defined leaning by 5 deg, and drag that grows faster than the speed."""


@pytest.mark.parametrize(("speed", "heading"), [(2.0, 1.0), (4.2, 0.0), (12.0, 2.0)])
def test_wind_on_a_trimmed_vehicle_is_wind_or_unknown_and_its_speed_is_covered(speed, heading):
    east, north = speed * np.cos(heading), speed * np.sin(heading)
    before = checked(TRIM, 1, 2)
    result = diagnose_change(checked({**TRIM, **wind(east, north)}, 7, 1), before, nominal())[0]
    assert {c.effect for c in result.changed} <= {"steady_wind"} and result.verdict != "none"
    assert result.verdict == ("named" if speed > 4.0 else result.verdict)
    for change in result.changed:
        for p, true in zip(change.theta, (east, north), strict=True):
            assert p.low < true < p.high
        assert "in proportion to the speed" in result.summary


def test_the_same_wind_before_and_now_is_no_change():
    before, now = (checked(wind(SPEED, 0.0), seed, 2) for seed in (2, 8))
    result = diagnose_change(now, before, nominal(), sessions={"*": "today"})[0]
    assert result.verdict == "none" and not result.changed

"""Flights with a force that no effect describes: their leftover says what it looks like."""

import pytest
from measured_flights import logs, nominal

from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.leftover_samples import flight_leftover

pytestmark = pytest.mark.slow


def leftover(sensors="imu_rpm", seed=1, **hidden):
    flights = logs(seed=seed, count=3, sensors=sensors, **hidden)
    problem = FlightProblem([track_of(log) for log in flights], nominal())
    return flight_leftover(problem, problem.null_hypothesis)


@pytest.mark.parametrize("sensors", ["imu_rpm", "mocap_rpm"])
def test_a_tether_is_a_spring_that_pulls_to_its_fixed_end(sensors):
    at, stiffness = (0.4, -0.3), 1.5
    result = leftover(sensors, disturbance=("tether", *at, 1.0, 0.0, stiffness))
    terms = {t.name: t for t in result.terms}
    name = next(n for n in ("spring to a point", "spring to a vertical line") if n in terms)
    spring = terms[name]
    assert spring.value == pytest.approx(-stiffness, rel=0.15)
    assert spring.low < spring.value < spring.high < 0.0
    for axis, place in zip("xy", at, strict=True):
        slack = -terms[f"constant in map {axis}"].value / spring.value
        assert slack == pytest.approx(place, abs=0.1)
        assert f"{axis} {slack:.2f} m" in spring.remark
    assert result.r2["force"] > 0.6
    assert "def leftover(" in result.effect and "Stage.WRENCH" in result.effect


def test_thrust_that_fades_is_described_by_time():
    result = leftover(disturbance=("thrust_fade", 0.006))
    (term,) = [t for t in result.terms if t.quantity == "force"]
    assert term.name == "thrust with time"
    assert term.value == pytest.approx(-0.006, rel=0.1)


def test_a_stiff_cable_is_described_by_yaw():
    result = leftover(disturbance=("yaw_spring", 0.05, 0.0))
    terms = {t.name: t for t in result.terms if t.quantity == "moment"}
    assert terms["sine of yaw"].value == pytest.approx(-0.05, rel=0.15)


@pytest.mark.parametrize("seed", [3, 4])
def test_healthy_flights_have_no_term(seed):
    result = leftover(seed=seed)
    assert result.terms == () and result.effect == ""
    assert set(result.r2.values()) == {0.0}

"""Flights with a force that no effect describes: their leftover says which variable it follows."""

import numpy as np
import pytest
from measured_flights import logs, nominal

from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.leftover import flight_leftover, held_out_r2


def leftover(sensors="imu_rpm", seed=1, **hidden):
    flights = logs(seed=seed, count=3, sensors=sensors, **hidden)
    problem = FlightProblem([track_of(log) for log in flights], nominal())
    return flight_leftover(problem, problem.null_hypothesis)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensors", "disturbance", "quantity", "variables"),
    [
        ("imu_rpm", ("tether", 0.4, -0.3, 1.0, 0.0, 1.5), "force", {"x", "y"}),
        ("mocap_rpm", ("tether", 0.4, -0.3, 1.0, 0.0, 1.5), "force", {"x", "y"}),
        ("imu_rpm", ("thrust_fade", 0.006), "force", {"t"}),
        ("imu_rpm", ("yaw_spring", 0.05, 0.0), "moment", {"yaw"}),
    ],
)
def test_an_unknown_force_is_told_with_the_variable_that_it_follows(
    sensors, disturbance, quantity, variables
):
    result = leftover(sensors, disturbance=disturbance)
    followed = {d.variable: d.r2 for d in result.dependences if d.quantity == quantity}
    assert variables <= set(followed)
    assert max(followed, key=lambda name: followed[name]) in variables


@pytest.mark.slow
def test_healthy_flights_follow_nothing():
    assert leftover(seed=3).dependences == ()


def test_only_what_other_flights_confirm_is_predicted():
    rng = np.random.default_rng(1)
    x = [rng.uniform(-1.0, 1.0, 400) for _ in range(3)]
    noise = [rng.standard_normal((400, 3)) for _ in range(3)]
    bent = [np.column_stack([v**2, np.zeros((400, 2))]) + 0.1 * e
            for v, e in zip(x, noise, strict=True)]  # fmt: skip
    assert held_out_r2(x, bent) > 0.8
    assert held_out_r2(x, noise) < 0.02
    assert held_out_r2(x[:1], bent[:1]) == 0.0
    turned = [sign * y for sign, y in zip((1.0, -1.0, 1.0), bent, strict=True)]
    assert held_out_r2(x, turned) < 0.0, "one flight contradicts the others"

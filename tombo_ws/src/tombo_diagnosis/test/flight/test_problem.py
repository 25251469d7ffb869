"""Observable parameters; noise common to slopes and residuals is not evidence."""

from dataclasses import replace

import numpy as np
import pytest
from measured_flights import SLOW, logs, nominal, tracks

from tombo_bag.flight import Series
from tombo_diagnosis.engine.regression import solve
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.nominal import PARAMETERS

pytestmark = pytest.mark.slow

PLACE = {p.label: p.index for p in PARAMETERS}
HIGH = ([{"x": 0.8, "speed": 1.5}, {"x": -0.8}, {"y": 0.8}, {"x": 0.0, "z": 1.6}, {"y": 0.0}],)
LANDING = ([*HIGH[0][:2], {"z": 0.35, "speed": 0.8}, {"z": 1.4}],)


def noisy_rotor_speeds(log, deviation=3.0):
    speed = log.series["rotor_speed"]
    noise = deviation * np.random.default_rng(5).standard_normal(speed.values.shape)
    series = {**log.series, "rotor_speed": Series(speed.t, speed.values + noise)}
    return log.with_series(series)


def freed(problem, label):
    """Mean and deviation of one parameter that alone is free, over its size that matters."""
    place = PLACE[label]
    column = problem.unknowns.places((place,))[0]
    solution = solve(problem.normal(), problem.unknowns.deviations((place,)))
    scale = problem.unknowns.parameters[place].scale
    return solution.mean[column] / scale, solution.covariance[column, column] ** 0.5 / scale


def test_noise_of_measured_rotor_speeds_is_no_inertia():
    # At one heading next to nothing is yaw moment but the noise, times the rotors' inertia.
    flown = logs(courses=SLOW)
    clean, _ = freed(
        FlightProblem([track_of(log) for log in flown], nominal()), "inertia_error.zz"
    )
    measured = [track_of(noisy_rotor_speeds(log)) for log in flown]
    mean, deviation = freed(FlightProblem(measured, nominal()), "inertia_error.zz")
    assert abs(mean - clean) < 2.0 * deviation


@pytest.mark.parametrize(("course", "shown"), [(HIGH, False), (LANDING, True)])
def test_what_shows_now_and_then_only_counts_by_these_moments(course, shown):
    problem = FlightProblem(tracks(sensors="mocap", courses=course), nominal())
    assert (PLACE["ground_effect.strength"] in problem.unknowns.identifiable) is shown


def test_thrust_gain_is_not_penalised_by_noise_of_measured_rotor_speeds():
    # Of moments that are all noise, stronger thrust would make more; that is none of its doing.
    stronger = {"thrust_coefficient_error": {"fraction": 0.12}}
    flown = [track_of(noisy_rotor_speeds(log, 20.0)) for log in logs(stronger, courses=SLOW)]
    problem = FlightProblem(flown, nominal())
    fit = problem.fit((PLACE["thrust_coefficient_error.fraction"],), {}, problem.null_hypothesis)
    assert fit.theta[PLACE["thrust_coefficient_error.fraction"]] == pytest.approx(0.12, abs=0.01)
    own = problem.channels[0]["fast"]
    turning = [k for k, c in enumerate(own) if c.name in ("turning x", "turning y")]
    for flight in range(len(flown)):
        before = problem.linears[flight].residual["fast"][:, turning].var(axis=0)
        after = problem.residual(fit, flight)["fast"][:, turning].var(axis=0)
        assert np.all(after < before)


def test_no_propeller_is_weaker_than_nothing():
    """A propeller stronger than new is not a weak one, even if that explains the flight."""
    strong = np.array([8.0, -2.0, -3.0, -3.0, 0.0, 0.0, 0.0, 0.0])
    problem = FlightProblem(tracks(draws=strong), nominal())
    place = PLACE["weak_propeller.front_right"]
    fit = problem.fit((place,), {}, problem.null_hypothesis)
    column = problem.unknowns.places((place,))[0]
    loss = fit.theta[place] + fit.solution.mean[column]
    assert loss > -problem.unknowns.parameters[place].tolerance


def test_parts_of_a_flight_are_no_further_flights():
    """A vehicle that its own flights were fitted to: two parts of one allow what one allows."""
    one, other = tracks(courses=SLOW)[0], tracks(courses=HIGH)[0]
    fitted = replace(nominal(), calibrated=True)
    every = [np.ones_like(rows) for rows in (one.fast_rows, one.slow_rows, one.pose_rows)]
    parts = FlightProblem([one, one.only(*every)], fitted)
    assert parts.setting.max_confidence == pytest.approx(2 / 3)
    assert FlightProblem([one, other], fitted).setting.max_confidence == pytest.approx(3 / 4)

"""Every effect of the registry is hidden in two short flights, and has to be found.

The hidden parameter is the most visible one on these courses, changed by its typical size. A new
effect is taken up by itself.
"""

import math
from functools import cache

import numpy as np
import pytest
from measured_flights import ROTOR_DRAWS, fly, logs, nominal, with_hidden

from tombo_diagnosis.engine.model_selection import search
from tombo_diagnosis.flight.analyse import analyse
from tombo_diagnosis.flight.causes import estimate_cause
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import track_of
from tombo_dynamics.effects import REGISTRY

pytestmark = pytest.mark.slow


@cache
def healthy_problem():
    return FlightProblem([track_of(log) for log in logs()], nominal())


def shown_best(effect):
    """Return the parameter of an effect that shows best; of a stochastic one the first."""
    problem = healthy_problem()
    power = np.diag(problem.normal().matrix)
    column = {i: power[place] for place, i in enumerate(problem.unknowns.indices)}
    own = [p for p in nominal().parameters if p.effect == effect]
    return max(own, key=lambda p: column.get(p.index, 0.0) * p.scale**2)


@cache
def flight(effect="", name="", value=0.0):
    return fly(with_hidden({effect: {name: value}} if effect else {}), seed=100, draws=ROTOR_DRAWS)


def hidden_value(p):
    """Return a value a typical size off the nominal one, to the side to which it still flies."""
    base = float(nominal().theta[p.index])
    for value in (base + p.scale, base - p.scale):
        if p.low <= value <= p.high:
            height = flight(p.effect, p.name, value).log["position"][4000:, 2]
            if height.size > 10_000 and height.min() > 0.3:
                return value
    raise AssertionError(f"{p.label} does not fly")


def is_seen(effect, name, value):
    """Return whether the flight is another one, or its sensors say something else."""
    one, other = flight(effect, name, value), flight()
    same = all(np.array_equal(one.log[k], other.log[k]) for k in ("position", "gyro", "accel"))
    arrivals = [flight["/mocap/pose"].arrival for flight in (one, other)]
    return not (same and np.array_equal(*arrivals))


def analysed(flights, p):
    """Return the causes, and a parameter's value and deviation."""
    tracks = [track_of(log) for log in flights]
    if p.index not in healthy_problem().unknowns.indices:
        findings = analyse(tracks, nominal())
        cause = estimate_cause(p.effect, findings, findings.search.best)
        fitted = next((f for f in cause.theta if f.name == p.name), None)
        wide = (fitted.high - fitted.low) / 3.92 if fitted else math.nan
        return findings.judgement.effects, fitted.value if fitted else math.nan, wide
    problem = FlightProblem(tracks, nominal())
    best = search(problem).best
    if p.index not in best.fit.free:
        return best.effects, math.nan, math.nan
    (place,) = problem.unknowns.places([p.index])
    deviation = math.sqrt(best.fit.solution.covariance[place, place])
    return best.effects, float(best.fit.theta[p.index]), deviation


@pytest.mark.parametrize("effect", REGISTRY)
def test_a_hidden_effect_is_found_with_its_size(effect):
    p = shown_best(effect)
    true = hidden_value(p)
    if REGISTRY[effect].vibration:  # declared to be no cause of motion
        assert p.index not in healthy_problem().unknowns.indices
        return
    if not is_seen(effect, p.name, true):
        assert p.index not in healthy_problem().unknowns.indices
        return
    causes, value, deviation = analysed(logs({effect: {p.name: true}}), p)
    assert causes[:1] == (effect,)
    change = abs(true - float(nominal().theta[p.index]))
    assert abs(value - true) < max(0.1 * change, 3.0 * deviation)
    assert deviation < change


def test_healthy_flights_have_no_cause():
    assert search(healthy_problem()).best.effects == ()

"""Gain of the extended model in flights that neither named nor fitted it."""

import math
from functools import cache, partial

import numpy as np
import pytest
from measured_flights import nominal
from measured_flights import tracks as flown

from tombo_diagnosis.engine.model_selection import search
from tombo_diagnosis.flight.cross_validation import (
    fit_without_flight,
    gain_by_effect,
    one_step_gains,
    open_loop_gains,
)
from tombo_diagnosis.flight.fit.problem import FlightProblem

pytestmark = pytest.mark.slow

tracks = partial(flown, length=22.0)
"""Windows of a second are compared: it takes some."""
DRAG = {"linear_rotor_drag": {"d_xy": 0.7}}
BALANCED = np.zeros(8)
"""Rotors that are alike: what others differ by turns a vehicle that is let go more than drag."""


@cache
def searched(hidden, count=3):
    problem = FlightProblem(tracks(DRAG if hidden else {}, count=count, draws=BALANCED), nominal())
    return problem, search(problem)


@cache
def gains(hidden, count=3):
    problem, outcome = searched(hidden, count)
    tried = [e for e in (outcome.best, *outcome.alternatives) if e.hypotheses]
    held = [fit_without_flight(problem, f, tried) for f in range(count)]
    return problem, held, one_step_gains(problem, held), open_loop_gains(problem, held)


def d_xy():
    return next(p.index for p in nominal().parameters if p.label == "linear_rotor_drag.d_xy")


def by_name(table):
    return {(g.channel, g.horizon): g for g in table}


def test_hidden_drag_is_learned_from_the_other_flights():
    _, held, steps, windows = gains(True)
    for each in held:
        assert each.after.theta[d_xy()] == pytest.approx(0.7, rel=0.1)
    table = by_name(steps)
    for axis in "xy":
        assert table[f"force {axis}", "one step"].reduction > 0.6
        assert table[f"force {axis}", "one step"].before > 0.1
    assert abs(table["rotor speed 1", "one step"].reduction) < 0.05
    ends = by_name(windows)
    for axis in "xy":
        for horizon in ("0.5 s", "1 s"):
            assert ends[f"velocity {axis}", horizon].reduction > 0.3
            place = ends[f"position {axis}", horizon]
            assert place.after < place.before
    assert {h for _, h in ends} == {"0.5 s", "1 s"}


def test_two_healthy_flights_have_no_gain_and_no_interval():
    _, held, steps, _ = gains(False, 2)
    for each in held:
        assert np.array_equal(each.after.theta, each.before.theta)
    assert all(g.reduction == 0.0 and math.isnan(g.low) and math.isnan(g.high) for g in steps)


def test_a_flight_that_is_held_out_teaches_nothing():
    """One flight has no drag of this kind: without it the others' drag is learned, and misfits."""
    odd = [*tracks(DRAG, count=2), *tracks(count=1, seed=7)]
    problem = FlightProblem(odd, nominal())
    best = search(problem).best
    assert "linear_rotor_drag" in best.effects
    alone, others = (fit_without_flight(problem, f, [best]).after.theta[d_xy()] for f in (2, 0))
    assert alone == pytest.approx(0.7, rel=0.1)
    assert others < alone - 0.1


def test_the_share_of_an_effect_is_one_where_it_is_all():
    problem, outcome = searched(True)
    shares = gain_by_effect(problem, outcome)
    assert shares["linear_rotor_drag"] > 0.8
    assert all(0.0 <= share <= 1.0 for share in shares.values())

"""Sessions as draws: answers on synthetic conditions are right as often as stated."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_sessions import KINDS, Vehicle, hidden

from tombo_bag.flight import Flight
from tombo_diagnosis.change.comparison import Spread, compare, spread_of
from tombo_diagnosis.change.features import Features
from tombo_diagnosis.change.sessions import healthy_sessions, known_sessions, sessions_by_demand
from tombo_diagnosis.change.signatures import candidates
from tombo_diagnosis.change.verdict import COVERED, NAMED, judge_change, most_confident
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_diagnosis.rotor_demand import MODES, SESSION_MODES
from tombo_dynamics.errors import InputError

CAUSES = ("named", "set")


@pytest.fixture(scope="module")
def tried():
    nominal = nominal_model()
    return candidates(nominal.vehicle, nominal.maps, np.geomspace(0.004, 0.5, 40))


def answer(vehicle, sessions, shift, tried):
    healthy, names = [], []
    for k in range(sessions):
        healthy += vehicle.session(3)
        names += [str(k)] * 3
    spread = spread_of(healthy, names, tried=tried)
    comparison = compare(spread, vehicle.session(3, shift), tried)
    return judge_change(comparison, most_confident(spread))


@pytest.mark.slow
def test_what_is_said_is_right_as_often_as_stated(tried):
    rng = np.random.default_rng(11)
    right, stated, changed, false_alarms, healthy = [], [], 0, 0, 0
    for k in range(240):
        kind = KINDS[k % len(KINDS)]
        shift, label = hidden(kind, rng)
        sessions = 1 + k % 3
        verdict = answer(Vehicle(rng), sessions, shift, tried)
        healthy += kind == "healthy"
        changed += kind != "healthy" and sessions > 1
        false_alarms += kind == "healthy" and verdict.verdict != "none"
        if kind != "healthy" and verdict.verdict in CAUSES:
            assert len(verdict.members) <= 3 and sessions > 1
            right.append(label in {m.candidate.label for m in verdict.members})
            stated.append(verdict.confidence)
    assert false_alarms <= 3 and healthy == 30
    assert sum(right) > 0.5 * changed and len(right) - sum(right) < 0.12 * changed
    assert np.mean(right) == pytest.approx(np.mean(stated), abs=0.1)


@pytest.mark.slow
def test_days_on_which_rotors_move_are_no_change(tried):
    """Forty vehicles whose rotors move by 3 to 12 % between days, of one to four healthy days."""
    rng, named = np.random.default_rng(5), 0
    modes = np.array(SESSION_MODES) / np.linalg.norm(SESSION_MODES)
    for k in range(40):
        deviation = np.exp(rng.uniform(np.log(0.03), np.log(0.12)))
        vehicle, days = Vehicle(rng), []
        vehicle.loose = 0.0
        for _ in range(2 + k % 4):
            move = np.zeros(9)
            move[:4] = 4.0 * MODES.T @ (deviation * modes * rng.standard_normal(4))
            days.append(vehicle.session(3, move))
        healthy = [f for day in days[:-1] for f in day]
        names = [str(d) for d, day in enumerate(days[:-1]) for _ in day]
        spread = spread_of(healthy, names, tried=tried)
        verdict = judge_change(compare(spread, days[-1], tried), most_confident(spread)).verdict
        named += verdict in CAUSES
    assert named <= 2


def test_where_healthy_sessions_are_accused_nothing_may_be_named():
    many = Spread(Features(np.zeros(9), 1.2), np.eye(9), np.eye(9), 5.0, 12, 4, left_out=4)
    assert most_confident(many) > 0.95
    assert most_confident(replace(many, false_alarms=2)) < COVERED
    assert most_confident(replace(many, false_alarms=3)) < 0.5
    assert most_confident(replace(many, left_out=3, sessions=1)) < NAMED


def test_sessions_are_those_given_else_dates_else_alike():
    flights = [Flight({}, name) for name in ("a_2026-03-01", "b20260302_1", "b20260302_2", "c")]
    flights[3] = replace(flights[3], epoch_ns=1_772_409_600 * 10**9)
    days = ["2026-03-01", "2026-03-02", "2026-03-02", "2026-03-02"]
    assert known_sessions(flights, {}) == days
    assert known_sessions(flights, {"b*": "two"}) == [days[0], "two", "two", days[3]]
    with pytest.raises(InputError, match=r"--session two=x\*: fits no flight"):
        known_sessions(flights, {"x*": "two"})
    vehicle = Vehicle(np.random.default_rng(2))
    first, second = vehicle.session(3), vehicle.session(2, np.full(9, 0.05))
    names = sessions_by_demand([*first, *second])
    assert len(set(names[:3])) == 1 and len(set(names[3:])) == 1 and names[0] != names[3]


def test_a_day_on_which_the_vehicle_does_not_stay_the_same_is_no_session():
    """New flights of that day are then of a further session, not of one known to differ little."""
    flights = [Flight({}, f"{k}_2026-03-05") for k in range(4)]
    vehicle = Vehicle(np.random.default_rng(2))
    alike, moved = vehicle.session(3), vehicle.session(1, np.full(9, 0.05))
    day = "2026-03-05"
    assert healthy_sessions(flights[:3], flights[3:], alike, {}) == ([day] * 3, day)
    names, same = healthy_sessions(flights[:3], flights[3:], [*alike[:2], *moved], {})
    assert same == "" and names[0] == names[1] != names[2]
    told = healthy_sessions(flights[:3], flights[3:], [*alike[:2], *moved], {"*": "one"})
    assert told == (["one"] * 3, "one")

"""What has changed in simulated flights of one vehicle: hidden there, found here."""

from functools import cache

import pytest
from measured_flights import logs, nominal

from tombo_diagnosis.change.diagnose import diagnose_change
from tombo_dynamics.errors import InputError

pytestmark = pytest.mark.slow


COURSE = ([{"x": 1.0, "speed": 1.0, "acceleration": 2.0}, {"x": -1.0}, {"y": 0.8}, {"y": 0.0}],)


@cache
def before():
    return logs(seed=1, count=3, courses=COURSE)


def now(hidden=None, **more):
    new = logs(hidden, seed=7, count=2, courses=COURSE, **more)
    return diagnose_change(new, before(), nominal())[0]


def members(diagnosis):
    return {(c.effect, c.rotor): c for c in diagnosis.changed}


@pytest.mark.parametrize("rotor", ["rear_left", "front_right"])
def test_a_weak_propeller_is_found_with_its_rotor_and_size(rotor):
    found = now({"weak_propeller": {rotor: 0.1}})
    assert found.verdict in ("named", "set") and {c.rotor for c in found.changed} == {rotor}
    weak = members(found)["weak_propeller", rotor].theta[0]
    assert found.changed[0].effect == "weak_propeller"
    assert weak.low < 0.1 < weak.high and weak.value == pytest.approx(0.1, abs=0.03)


def test_two_weak_propellers_are_found():
    found = now({"weak_propeller": {"rear_left": 0.1, "front_right": 0.1}})
    assert found.verdict == "named"
    assert set(members(found)) == {("weak_propeller", r) for r in ("rear_left", "front_right")}


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_a_weight_at_a_rotor_is_found_with_its_mass(share):
    """A small one may be a day's air or battery with another centre of gravity."""
    at = 0.24 * share / (1.0 + share) / 2.0**0.5
    found = now({"mass_error": {"fraction": share}, "cog_offset": {"x": at, "y": -at}})
    beside = {("cog_offset", "")} if share < 0.1 else set()
    assert {c.rotor for k, c in members(found).items() if k not in beside} == {"front_right"}
    weight = members(found)["added_weight", "front_right"].theta[0]
    assert weight.low < share * 1.3 < weight.high


def test_a_load_on_a_thread_at_a_rotor_is_a_set_with_its_rotor_and_mass():
    at = 0.24 / 2.0**0.5
    found = now({"hanging_load": {"mass": 0.065, "length": 0.5, "x": at, "y": -at}})
    assert {c.rotor for c in found.changed} == {"front_right"} and len(found.changed) <= 3
    load = members(found)["hanging_load", "front_right"].theta[0]
    assert load.low < 0.065 < load.high


def test_another_mass_is_a_set_with_another_thrust():
    found = now({"mass_error": {"fraction": 0.06}})
    assert found.verdict == "set"
    assert set(found.set) == {"mass_error", "thrust_coefficient_error"}
    assert members(found)["mass_error", ""].theta[0].value == pytest.approx(0.06, abs=0.02)


def test_another_centre_of_gravity_is_found_with_its_place():
    found = now({"cog_offset": {"x": 0.01}})
    assert found.verdict == "named"
    x, y = members(found)["cog_offset", ""].theta
    assert (x.value, y.value) == pytest.approx((0.01, 0.0), abs=0.003)


def test_a_healthy_flight_has_not_changed():
    found = now()
    assert found.verdict == "none" and not found.changed
    assert found.confidence <= 0.75  # three healthy flights certify no more


def test_another_set_of_propellers_each_day_hides_a_weak_one():
    """Where healthy flights differ as much as what is asked for, nothing is named."""
    healthy = [logs(seed=k, count=1, courses=COURSE, draws=None)[0] for k in (1, 2, 3)]
    new = logs({"weak_propeller": {"rear_left": 0.03}}, 9, 1, courses=COURSE, draws=None)
    assert diagnose_change(new, healthy, nominal())[0].verdict != "named"


def test_a_flight_without_commands_is_refused_by_name():
    log = before()[0]
    blind = type(log)("blind", "", {"position": log.series["position"]})
    with pytest.raises(InputError, match=r"flight 'blind'.*rotor_speed"):
        diagnose_change([blind], before(), nominal())

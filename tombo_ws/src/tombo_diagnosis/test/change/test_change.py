"""The change in simulated flights of a vehicle: hidden there, found here."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from measured_flights import logs as flown
from measured_flights import nominal

from tombo_bag.flight import Series
from tombo_diagnosis.change.diagnose import diagnose_change
from tombo_dynamics.errors import InputError

pytestmark = pytest.mark.slow

logs = partial(flown, length=22.0)
"""A share of the demand is compared: it takes its time, and no fit."""
COURSE = ([{"x": 1.0, "speed": 1.0, "acceleration": 2.0}, {"x": -1.0}, {"y": 0.8}, {"y": 0.0}],)


@cache
def before():
    return logs(seed=1, count=3, courses=COURSE)


def compared(new, healthy, **more):
    """Of one session, as flights of one simulated vehicle are."""
    return diagnose_change(new, healthy, nominal(), sessions={"*": "today"}, **more)


def now(hidden=None, **more):
    new = logs(hidden, seed=7, count=2, courses=COURSE, **more)
    return compared(new, before())[0]


def members(diagnosis):
    return {(c.effect, c.rotor): c for c in diagnosis.changed}


@pytest.mark.parametrize("rotor", ["rear_left", "front_right"])
def test_a_weak_propeller_is_found_with_its_rotor_and_size(rotor):
    result = now({"weak_propeller": {rotor: 0.1}})
    assert result.verdict in ("named", "set") and {c.rotor for c in result.changed} == {rotor}
    weak = members(result)["weak_propeller", rotor].theta[0]
    assert result.changed[0].effect == "weak_propeller"
    assert weak.low < 0.1 < weak.high and weak.value == pytest.approx(0.1, abs=0.03)


def test_two_weak_propellers_are_found():
    result = now({"weak_propeller": {"rear_left": 0.1, "front_right": 0.1}})
    assert result.verdict == "named"
    assert set(members(result)) == {("weak_propeller", r) for r in ("rear_left", "front_right")}


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_a_weight_at_a_rotor_is_found_with_its_mass(share):
    """A small one may be a day's air or battery with another centre of gravity."""
    at = 0.24 * share / (1.0 + share) / 2.0**0.5
    result = now({"mass_error": {"fraction": share}, "cog_offset": {"x": at, "y": -at}})
    beside = {("cog_offset", "")} if share < 0.1 else set()
    assert {c.rotor for k, c in members(result).items() if k not in beside} == {"front_right"}
    weight = members(result)["added_weight", "front_right"].theta[0]
    assert weight.low < share * 1.3 < weight.high


def test_a_load_on_a_thread_at_a_rotor_is_a_set_with_its_rotor_and_mass():
    at = 0.24 / 2.0**0.5
    result = now({"hanging_load": {"mass": 0.065, "length": 0.5, "x": at, "y": -at}})
    assert {c.rotor for c in result.changed} == {"front_right"} and len(result.changed) <= 3
    load = members(result)["hanging_load", "front_right"].theta[0]
    assert load.low < 0.065 < load.high


def test_another_mass_is_a_set_with_another_thrust():
    result = now({"mass_error": {"fraction": 0.06}})
    assert result.verdict == "set"
    assert set(result.set) == {"mass_error", "thrust_coefficient_error"}
    assert members(result)["mass_error", ""].theta[0].value == pytest.approx(0.06, abs=0.02)


def test_another_centre_of_gravity_is_found_with_its_place():
    result = now({"cog_offset": {"x": 0.01}})
    assert result.verdict == "named"
    x, y = members(result)["cog_offset", ""].theta
    assert (x.value, y.value) == pytest.approx((0.01, 0.0), abs=0.003)


def test_a_healthy_flight_has_not_changed():
    result = now()
    assert result.verdict == "none" and not result.changed
    assert result.confidence < 0.98  # three healthy flights certify no more


POSES = {"position", "attitude"}


def only(flights, channels):
    return [
        log.with_series({k: s for k, s in log.series.items() if k in channels}) for log in flights
    ]


def at_speeds_times(log, factor):
    """The flight of a vehicle whose rotors have to turn faster."""
    speed = log.series["rotor_speed"]
    return log.with_series({**log.series, "rotor_speed": Series(speed.t, factor * speed.values)})


@pytest.mark.parametrize(("share", "channels"), [(0.1, {"rotor_speed"}), (0.2, {"rotor_command"})])
def test_more_demand_is_found_without_an_imu(share, channels):
    healthy = only(before(), POSES | channels)
    new = only(
        logs({"mass_error": {"fraction": share}}, seed=7, count=2, courses=COURSE),
        POSES | channels,
    )
    result = compared(new, healthy)[0]
    assert set(result.set) == {"mass_error", "thrust_coefficient_error"}
    mass = members(result)["mass_error", ""].theta[0]
    assert mass.low < share < mass.high and mass.value == pytest.approx(share, rel=0.25)


def test_none_states_the_smallest_change_that_would_have_been_seen():
    healthy = only(before(), POSES | {"rotor_command"})
    new = only(logs(seed=7, count=2, courses=COURSE), POSES | {"rotor_command"})
    result, data = compared(new, healthy)
    assert result.verdict == "none" and "would have shown" in result.summary
    size = next(s.detectable.size for s in result.candidates if s.effect == "mass_error")
    assert 0.02 < size < 0.1
    for times, verdict in ((0.3, "none"), (2.0, "set")):
        more = (1.0 + times * size) ** (1.0 / data.curve.exponent)
        series = [{**log.series, "rotor_command": _times(log, more)} for log in new]
        shown = [log.with_series(s) for log, s in zip(new, series, strict=True)]
        assert compared(shown, healthy)[0].verdict == verdict, times


def _times(log, factor):
    command = log.series["rotor_command"]
    return Series(command.t, factor * command.values)


def test_a_flight_that_never_leaves_the_ground_is_reported_not_to_fly():
    log = at_speeds_times(before()[0], 0.3)
    position = log.series["position"]
    rng = np.random.default_rng(0)
    still = Series(position.t, 0.05 + 1e-3 * rng.standard_normal(position.values.shape))
    idle = replace(log.with_series({**log.series, "position": still}), name="idle")
    with pytest.raises(InputError, match=r"flight 'idle': it does not fly: .*rotor_speed"):
        compared([idle], before())


def test_another_set_of_propellers_each_day_hides_a_weak_one():
    """Where healthy flights differ as much as what is asked for, nothing is named."""
    healthy = [logs(seed=k, count=1, courses=COURSE, draws=None)[0] for k in (1, 2, 3)]
    new = logs({"weak_propeller": {"rear_left": 0.03}}, 9, 1, courses=COURSE, draws=None)
    assert compared(new, healthy)[0].verdict != "named"


def test_a_flight_without_commands_is_refused_by_name():
    log = before()[0]
    blind = replace(log, name="blind").with_series({"position": log.series["position"]})
    with pytest.raises(InputError, match=r"flight 'blind'.*rotor_speed"):
        compared([blind], before())

"""`diagnose`: from logs to a diagnosis that is complete."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from measured_flights import SLOW, logs, nominal

from tombo_bag.flight import Airframe, Finding, Series
from tombo_diagnosis.diagnosis import VERDICTS
from tombo_diagnosis.flight.causes import shown_by_scale
from tombo_diagnosis.flight.diagnose import check_flights, diagnose_flights
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import FittedParameter

pytestmark = pytest.mark.slow

HIDDEN = {"steady_wind": {"east": 1.5}, "mass_error": {"fraction": 0.1}}
WIND = {"steady_wind": {"east": 1.5}}
FRAME = Airframe("Other", 0.03, 0.03, 0.02)


@pytest.fixture(scope="module")
def named():
    times = iter([10.0, 12.5])
    return diagnose_flights(logs(HIDDEN, count=3), nominal(), clock=lambda: next(times))[0]


def test_what_was_hidden_is_named_with_its_size(named):
    assert named.verdict == "named" and {c.effect for c in named.causes} == set(HIDDEN)
    for cause in named.causes:
        fitted = {f.name: f for f in cause.theta}
        for name, value in HIDDEN[cause.effect].items():
            own = fitted[name]
            assert own.low <= own.value <= own.high
            assert own.value == pytest.approx(value, rel=0.1)
            assert own.nominal == 0.0
            wide = own.high - own.low
            assert own.low - 0.5 * wide < value < own.high + 0.5 * wide
        assert 0.5 < cause.confidence < 1.0
        assert cause.signature == REGISTRY[cause.effect].signature
        matrix = np.array(cause.covariance)
        assert matrix.shape == (len(cause.theta),) * 2
        assert matrix == pytest.approx(matrix.T) and (np.linalg.eigvalsh(matrix) > 0).all()


def test_every_field_is_filled_in(named):
    assert named.verdict in VERDICTS and 0.5 < named.confidence < 1.0
    assert {c.effect for c in named.candidates} == set(REGISTRY)
    assert sum(c.probability for c in named.candidates) <= 1.0 + 1e-9
    assert all(c.excited or c.remark for c in named.candidates)
    assert all(f.formulation == "imu" and 5.0 < f.used_s < f.duration_s for f in named.flights)
    assert any(g.reduction > 0.3 for g in named.gain)
    assert {g.horizon for g in named.gain} == {"one step", "0.5 s", "1 s"}
    assert named.model == nominal().label and named.seconds == 2.5


def test_residuals_are_there_before_and_after(named):
    for r in named.residuals:
        assert r.t.shape == r.before.shape == r.after.shape
        # no noise of the supply and of measured speeds is known
        assert r.sigma >= 0.0 or r.channel.startswith(("voltage", "rotor speed"))
    force = [r for r in named.residuals if r.channel == "force z"]
    before, after = (np.mean([np.abs(getattr(r, k).mean()) for r in force]) for k in (
        "before", "after"))  # fmt: skip
    assert after < 0.2 * before


def test_with_nothing_hidden_nothing_is_added():
    diagnosis = diagnose_flights(logs(seed=5, count=3), nominal())[0]
    assert diagnosis.verdict == "none" and diagnosis.causes == () and diagnosis.gain == ()
    for r in diagnosis.residuals:
        assert np.array_equal(r.before, r.after)
    assert "chance" in diagnosis.summary


def test_a_single_short_flight_says_what_it_can_not_certify():
    diagnosis = diagnose_flights(logs(WIND, count=1, length=13.0), nominal())[0]
    assert diagnosis.verdict == "named" and diagnosis.causes[0].effect == "steady_wind"
    assert any("certify" in note and "flight" in note for note in diagnosis.notes)
    assert all(math.isnan(g.low) for g in diagnosis.gain)
    assert diagnosis.flights[0].used_s < 10.0


def test_a_single_flight_is_cut_into_parts_that_are_held_out_in_turn():
    (log,) = logs(WIND, count=1, length=22.0)
    diagnosis = diagnose_flights([log], nominal())[0]
    assert len(diagnosis.flights) >= 2
    assert all(flight.name.startswith(log.name) for flight in diagnosis.flights)
    shown = [r for r in diagnosis.residuals if r.channel == "force x"]
    assert all(a.t[-1] < b.t[0] for a, b in pairwise(shown))
    assert any(g.reduction > 0.5 for g in diagnosis.gain)


def test_a_set_says_what_separates_it():
    flights = logs({"steady_wind": {"east": 1.0}}, courses=SLOW, sensors="mocap")
    diagnosis = diagnose_flights(flights, nominal())[0]
    assert diagnosis.verdict == "set" and set(diagnosis.set) == {
        "steady_wind",
        "mocap_misalignment",
    }
    assert "wind" in diagnosis.separating_experiment.text
    assert [c.effect for c in diagnosis.causes] == list(diagnosis.set) and all(
        c.theta for c in diagnosis.causes
    )
    assert any("IMU" in note for note in diagnosis.notes)


def test_flights_of_different_vehicles_are_refused():
    ours, theirs = logs(count=2)
    with pytest.raises(InputError, match=r"flight 1.*accepted: flights of one vehicle"):
        diagnose_flights([ours, replace(theirs, airframe=FRAME)], nominal())
    with pytest.raises(InputError, match="accepted: flights of one vehicle"):
        other = replace(FRAME, mass=0.05)
        diagnose_flights(
            [replace(ours, airframe=other), replace(theirs, airframe=FRAME)], nominal()
        )


def test_no_flight_that_can_be_used_says_why():
    (log,) = logs(count=1)
    blind = log.with_series({k: v for k, v in log.series.items() if k != "attitude"})
    with pytest.raises(InputError, match=r"flight 1.*attitude.*accepted"):
        diagnose_flights([blind], nominal())
    with pytest.raises(InputError, match="accepted: at least 2 s"):
        diagnose_flights([replace(log, exclude=((-1.0, 1e3),))], nominal())


def test_a_flight_that_can_not_be_used_is_left_out_and_reported():
    good, bad = logs(WIND, count=2)
    note = Finding("gap", "warning", good.name, "position: a gap")
    bad = bad.with_series({k: v for k, v in bad.series.items() if k != "position"})
    diagnosis = diagnose_flights([replace(good, findings=(note,)), bad], nominal())[0]
    assert {f.name for f in diagnosis.flights} and not [
        f for f in diagnosis.flights if "2" in f.name[:8]
    ]
    assert note in diagnosis.prechecks
    assert any(f.flight == bad.name and f.severity == "fault" for f in diagnosis.prechecks)


def in_mm(log):
    position = log.series["position"]
    return log.with_series(
        {**log.series, "position": replace(position, values=1e3 * position.values)}
    )


def test_a_flight_that_contradicts_itself_costs_only_itself():
    one, two = logs(WIND, count=2)
    checked, (why,) = check_flights([one, in_mm(two)])
    assert [flight.name for flight in checked] == [one.name]
    assert (why.check, why.severity, why.flight) == ("refused", "fault", two.name)
    assert "mm declared as m" in why.message
    with pytest.raises(InputError, match=r"flight 1.*mm declared as m"):
        check_flights([in_mm(one), in_mm(two)])


def test_a_flight_without_an_imu_among_others_is_left_out_and_reported():
    one, two = logs(count=2)
    bare = {k: v for k, v in two.series.items() if k not in ("gyro", "accel")}
    diagnosis = diagnose_flights([one, two.with_series(bare)], nominal())[0]
    assert all(f.formulation == "imu" for f in diagnosis.flights)
    assert any("no IMU" in f.message for f in diagnosis.prechecks)


def test_poses_that_repeat_stumble_or_are_not_finite_do_no_harm():
    (log,) = logs(WIND, count=1)
    place, turn = log.series["position"], log.series["attitude"]
    values, flipped = place.values.copy(), turn.values.copy()
    values[300] = np.nan
    flipped[200:250] *= -1.0
    t = place.t.copy()
    t[400] = t[399]
    series = {**log.series, "position": Series(t, values, place.arrival),
              "attitude": Series(t, flipped, turn.arrival)}  # fmt: skip
    diagnosis = diagnose_flights([log.with_series(series)], nominal())[0]
    assert diagnosis.verdict == "named" and diagnosis.causes[0].effect == "steady_wind"


@pytest.mark.parametrize(
    ("effect", "name", "value", "shown"),
    [
        ("cog_offset", "x", 1e-3, False), ("cog_offset", "y", -3e-3, True),
        ("mass_error", "fraction", 0.02, False), ("mass_error", "fraction", 0.1, True),
        ("imu_bias", "accel_x", 1e-3, True),
    ],
)  # fmt: skip
def test_a_change_that_no_scale_shows_is_told_from_one_that_it_shows(effect, name, value, shown):
    small = nominal_model(vehicle="crazyflie_2_1").vehicle
    fitted = FittedParameter(name, "", 0.0, value, value, value)
    assert shown_by_scale(effect, (fitted,), small) is shown

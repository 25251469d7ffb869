"""Stamps: late, jittering, backwards, twice; samples: missing, frozen, held, drawn."""

import numpy as np
import pytest
from made_flight import made_flight, poses_only, with_series, with_values, wrote

from tombo_bag.flight import Series
from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.checks.pipeline import _motion
from tombo_logs.checks.pose_imu_consistency import time_offset

FLIGHT = made_flight()
POSE = ("position", "attitude")


def with_poses(change):
    """The flight with times and values of position and attitude changed alike."""
    series = {c: Series(*change(FLIGHT.series[c].t, FLIGHT.series[c].values)) for c in POSE}
    return with_series(FLIGHT, **series)


@pytest.mark.parametrize("late", [-0.05, -0.012, 0.0, 0.008, 0.03, 0.11])
@pytest.mark.parametrize("rate", [30.0, 100.0])
def test_how_late_stamps_are_is_found_within_its_uncertainty(late, rate):
    checked = check_log(made_flight(late=late, mocap_hz=rate))
    found = time_offset(_motion(dict(checked.series), list(checked.exclude)))
    assert abs(found.lag - late) < max(3.0 * found.sigma, 0.002)
    assert found.sigma < 0.004


def test_late_stamps_are_said_and_small_lags_are_not():
    (late,) = wrote(check_log(made_flight(late=0.03)), "30 ±", "later than the gyro's")
    assert (late.check, late.severity) == ("stamps", "warning")
    (early,) = wrote(check_log(made_flight(late=-0.012)), "12 ±", "earlier than")
    assert early.severity == "info"
    assert not wrote(check_log(made_flight(late=0.002)), "than the gyro's")


def shaken(t):
    """Stamps that are late by another time each."""
    return t + np.random.default_rng(2).gamma(2.0, 0.0015, t.size)


def part(channel, begin, end):
    """The flight with a channel from one time to another only."""
    s = FLIGHT.series[channel]
    rows = (s.t > begin) & (s.t < end)
    return with_series(FLIGHT, **{channel: Series(s.t[rows], s.values[rows])})


def thinned(channel, share):
    """The flight with a share of a channel's samples lost one by one."""
    s = FLIGHT.series[channel]
    kept = np.random.default_rng(3).random(s.t.size) > share
    return with_series(FLIGHT, **{channel: Series(s.t[kept], s.values[kept])})


def stamped(channel, change, arrival=None):
    """The flight with other stamps on a channel."""
    s = FLIGHT.series[channel]
    return with_series(FLIGHT, **{channel: Series(change(s.t), s.values, arrival)})


ARRIVAL = FLIGHT.series["position"].t + 1e-5


@pytest.mark.parametrize(
    ("log", "texts"),
    [
        (with_poses(lambda t, values: (shaken(t), values)), ["position: stamps jitter"]),
        (stamped("position", np.copy, ARRIVAL), ["position: stamps are the times of recording"]),
        (stamped("gyro", lambda t: t - np.where(t > 12.0, 0.6, 0.0)),
         ["gyro: stamps jump back by 0.59", "the clock was set"]),
        (stamped("rotor_command", lambda t: t + 0.12), ["rotor_command: the vehicle", "before"]),
        (stamped("rotor_command", lambda t: t - 0.25), ["rotor_command: the vehicle", "after"]),
        (thinned("gyro", 0.15), ["gyro: 1", "% of the samples are lost"]),
        (part("rotor_speed", 14.0, 99.0), ["rotor_speed: covers 14.0 to 20.0 s", "left out"]),
        (part("gyro", -1.0, 12.0), ["gyro: covers 0.0 to 12.0 s", "the rest is set apart"]),
        (with_values(FLIGHT, "gyro", lambda w: np.where(np.arange(len(w))[:, None] // 200 == 5,
                                                        np.nan, w)), ["gyro: 200 of"]),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_channel_is_said(log, texts):
    checked = check_log(log)
    (said,) = wrote(checked, *texts)
    assert "left out" not in texts or said.channel not in checked.series
    assert said.channel == texts[0].partition(":")[0] and not wrote(checked, "gyro", "backwards")
    assert all(np.isfinite(s.values).all() for s in checked.series.values())
    if "set apart" in texts[-1]:
        assert any(b <= said.start_s and e >= said.end_s for b, e in checked.exclude)


def test_backwards_and_double_stamps_are_put_right():
    position = FLIGHT.series["position"]
    order = np.arange(position.t.size)
    order[300:310] = order[300:310][::-1]
    order = np.insert(order, 700, [699] * 60)
    mixed = Series(position.t[order], position.values[order])
    checked = check_log(with_series(FLIGHT, position=mixed))
    np.testing.assert_array_equal(checked.series["position"].t, position.t)
    np.testing.assert_array_equal(checked.series["position"].values, position.values)
    assert wrote(checked, "9 stamps go backwards") and wrote(checked, "60 stamps are there twice")


def test_a_clock_that_was_set_leaves_the_longest_part():
    checked = check_log(with_poses(lambda t, v: (t + np.where(t > 13.0, -9.0, 0.0), v)))
    assert checked.series["position"].t[-1] < 13.01
    faults = wrote(checked, "jump back by 8.99 s")
    assert {f.channel for f in faults} == set(POSE) and faults[0].severity == "fault"


def clock(log, factor, channels):
    series = {c: Series(factor * log.series[c].t, log.series[c].values) for c in channels}
    return with_series(log, **series)


@pytest.mark.parametrize("factor", [1e3, 1e9])
def test_stamps_in_another_unit_are_named(factor):
    checked = check_log(clock(FLIGHT, factor, ("gyro",)))
    assert wrote(checked, "gyro: its stamps run from 0 to", "declared as s")
    assert "gyro" not in checked.series
    with pytest.raises(InputError, match=r"position: its stamps.* declared as s"):
        check_log(clock(FLIGHT, factor, FLIGHT.series))


def test_saturated_readings_are_said():
    checked = check_log(with_values(FLIGHT, "gyro", lambda w: np.clip(w, -0.9, 0.9)))
    assert wrote(checked, "gyro: reads exactly its limit of 0.9")
    coarse = with_values(FLIGHT, "gyro", lambda w: np.round(w / 0.1) * 0.1)
    assert not wrote(check_log(coarse), "limit")


def test_gaps_are_counted_and_the_longest_is_dated():
    t = FLIGHT.series["position"].t
    keep = (np.abs(t - 9.0) > 0.4) & (np.abs(t - 12.0) > 0.1)
    holed = with_poses(lambda t, values: (t[keep], values[keep]))
    (gap,) = wrote(check_log(holed), "position: 2 gaps")
    assert gap.severity == "warning"
    assert (gap.start_s, gap.end_s) == pytest.approx((8.6, 9.4), abs=0.021)


def test_frozen_poses_are_set_apart():
    rows = np.arange(FLIGHT.series["position"].t.size)
    rows[900:980] = 900
    checked = check_log(with_poses(lambda t, values: (t, values[rows])))
    frozen = [f for f in checked.findings if f.check == "frozen"]
    assert {f.channel for f in frozen} == set(POSE)
    for f in frozen:
        assert (f.start_s, f.end_s) == pytest.approx((9.0, 9.79), abs=0.011)
    assert any(b <= 9.0 and e >= 9.79 for b, e in checked.exclude)


def test_a_straight_line_is_no_measurement():
    def line(values):
        values[1600:1800] = np.linspace(values[1600], values[1799], 200)
        return values

    checked = check_log(with_values(FLIGHT, "gyro", line))
    (drawn,) = wrote(checked, "gyro: a straight line over 1.00 s: interpolated")
    assert drawn.severity == "fault"
    assert any(b <= 8.0 and e >= 8.99 for b, e in checked.exclude)


def test_extrapolated_data_are_not_taken_for_a_crash():
    def line(values):
        slope = np.array([15.0, 4.0, 20.0])[: values.shape[1]] / 200.0
        values[2400:] = values[2400] + slope * np.arange(len(values) - 2400)[:, None]
        return values

    flight = with_values(with_values(FLIGHT, "accel", line), "gyro", line)
    checked = check_log(flight)
    (crash,) = [f for f in checked.findings if f.check == "crash"]
    assert "what crashed is the log" in crash.message
    assert checked.exclude[-1][0] < 12.0 and checked.exclude[-1][1] >= 19.9


def test_poses_held_on_a_faster_clock_are_thinned():
    checked = check_log(with_poses(lambda t, v: (t, v[np.arange(len(v)) // 3 * 3])))
    assert wrote(checked, "position: 67 % of the samples repeat")
    assert np.median(np.diff(checked.series["position"].t)) == pytest.approx(0.03, abs=1e-6)
    assert not [f for f in checked.findings if f.severity == "fault"]


def test_a_channel_of_nothing_is_left_out_and_poses_are_needed():
    checked = check_log(with_values(FLIGHT, "gyro", lambda w: w * np.nan))
    assert "gyro" not in checked.series
    assert [f.channel for f in wrote(checked, "left out")] == ["gyro"]
    for missing in POSE:
        with pytest.raises(InputError, match=f"no usable {missing}: 0 samples; needed: position"):
            check_log(with_series(FLIGHT, **{missing: None}))


def test_stamps_that_reach_over_years_are_refused():
    late = {n: Series(np.append(s.t[:-1], 2e9), s.values) for n, s in FLIGHT.series.items()}
    with pytest.raises(InputError, match="stamps reach over"):
        check_log(FLIGHT.with_series(late))


def test_poses_alone_are_enough():
    said = [f for f in check_log(poses_only(FLIGHT)).findings if f.severity != "info"]
    assert [(f.check, f.channel) for f in said] == [
        ("missing", "gyro"),
        ("missing", "rotor_speed"),
    ]
    assert all("can't be seen" in f.message for f in said)


@pytest.mark.parametrize(
    ("factor", "text"),
    [(1.0005, "0.051 % fast"), (1.002, "0.2 % fast"), (0.98, "2 % slow"), (1.00002, "")],
)
def test_an_imu_clock_that_is_fast_or_slow_is_corrected(factor, text):
    checked = check_log(clock(FLIGHT, factor, ("gyro", "accel")))
    said = wrote(checked, "gyro: its clock is", text)
    assert [(f.check, f.severity) for f in said] == [("stamps", "warning")] * bool(text)
    for name in ("gyro", "accel"):
        np.testing.assert_allclose(checked.series[name].t, FLIGHT.series[name].t, atol=0.001)

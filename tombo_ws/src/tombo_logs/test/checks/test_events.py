"""Crashes, contacts, jumps of the motion capture, and the ground."""

from dataclasses import replace

import numpy as np
import pytest
from made_flight import (
    STAND,
    Series,
    made_flight,
    poses_only,
    recorded,
    with_series,
    with_values,
    wrote,
)

from tombo_bag.flight import Airframe
from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.checks.rotors.motors import Hover
from tombo_logs.checks.samples import without_wrong_poses

FLIGHT = made_flight(duration=24.0)


def part_of(log, begin=-1.0, end=99.0):
    series = {}
    for name, s in log.series.items():
        keep = (s.t > begin) & (s.t < end)
        series[name] = Series(s.t[keep], s.values[keep])
    return log.with_series(series)


def pushed(channel, rows, push):
    """The flight with a push of a channel's rows."""

    def change(values):
        values[rows] += push
        return values

    return with_values(FLIGHT, channel, change)


def findings_by(log, check):
    return [f for f in log.findings if f.check == check]


@pytest.mark.parametrize(
    ("name", "first", "last"),
    [("paper_collision_0", 23.099, 23.261), ("paper_collision_7", 23.097, 23.243),
     ("known_obstacle_1", 23.116, 23.128)],
)  # fmt: skip
def test_a_strike_is_found_in_the_poses_and_set_apart_with_the_recovery(name, first, last):
    """Times of contact from the simulation's truth, which the checks don't see."""
    (contact,) = findings_by(check_log(recorded(name)), "contact")
    assert first - 0.5 < contact.start_s < first
    assert last + 1.9 < contact.end_s < last + 2.4


def test_a_strike_that_ends_on_the_ground_is_a_crash():
    checked = check_log(recorded("soft_strike_3"))
    (crash,) = findings_by(checked, "crash")
    assert 22.6 < crash.start_s < 23.11
    assert checked.exclude[-1][1] == checked.series["position"].t[-1]


def test_a_blow_to_the_accelerometer_is_a_contact():
    blow = pushed("accel", slice(2400, 2404), [50.0, 0.0, 20.0])
    (contact,) = findings_by(check_log(blow), "contact")
    assert contact.start_s == pytest.approx(11.75, abs=0.02)
    assert contact.end_s == pytest.approx(14.0, abs=0.05)


def test_a_blow_at_landing_is_none():
    checked = check_log(pushed("accel", int((24.0 - STAND) * 200), [0.0, 0.0, 400.0]))
    assert not findings_by(checked, "contact") and not findings_by(checked, "crash")


@pytest.mark.parametrize("only_poses", [False, True])
def test_markers_that_swap_are_no_contact(only_poses):
    flight = pushed("position", slice(1200, 1204), [0.4, 0.0, 0.0])
    checked = check_log(poses_only(flight) if only_poses else flight)
    (jump,) = findings_by(checked, "jump")
    assert jump.start_s < 12.0 < 12.04 < jump.end_s < 13.0
    assert not findings_by(checked, "contact")


@pytest.mark.parametrize("only_poses", [False, True])
def test_single_wrong_poses_are_left_out_alone(only_poses):
    rows = [700, 1200, 1203, 1500]
    flight = pushed(
        "position", rows, [[0.03, 0.0, 0.0], [0.0, 0.08, 0.0], [0, 0, 0.05], [0, 1, 0]]
    )
    checked = check_log(poses_only(flight) if only_poses else flight)
    (said,) = findings_by(checked, "jump")
    assert said.severity == "info" and "up to 100 cm" in said.message and ": 4," in said.message
    left = FLIGHT.series["position"].t[rows]
    assert not np.isin(left, checked.series["position"].t).any()
    assert checked.series["position"].t.size == FLIGHT.series["position"].t.size - len(rows)
    assert not findings_by(checked, "contact") and len(checked.exclude) == 2  # on the ground


@pytest.mark.parametrize("samples", [0, 2, 3])
def test_bends_and_steps_of_the_track_are_no_wrong_poses(samples):
    """It is thrown back, or lies elsewhere for a few poses: nothing is left out."""
    t = FLIGHT.series["position"].t
    thrown = 3.0 * np.maximum(t - 12.0, 0.0) * (t < 13.0)
    shifted = 0.1 * ((t > 12.0) & (t < 12.0 + 0.01 * samples + 0.005))
    off = np.column_stack([shifted if samples else thrown, 0.0 * t, 0.0 * t])
    position = Series(t, FLIGHT.series["position"].values + off)
    kept, said = without_wrong_poses("a", Series(t[:1250], position.values[:1250]))
    assert kept.t.size == 1250 and not said


def test_a_fall_out_of_the_air_is_a_crash():
    """The log ends soon after the vehicle has turned over."""
    flight = part_of(FLIGHT, end=14.0)

    def over(values):
        t = flight.series["attitude"].t
        angle = np.clip((t - 13.0) / 0.6, 0.0, 1.0) * np.pi
        values[:, 0], values[:, 1:3], values[:, 3] = np.sin(angle / 2), 0.0, np.cos(angle / 2)
        return np.where((t > 13.0)[:, None], values, FLIGHT.series["attitude"].values[: t.size])

    checked = check_log(poses_only(with_values(flight, "attitude", over)))
    (crash,) = findings_by(checked, "crash")
    assert 12.5 < crash.start_s < 13.5 and crash.end_s > 13.9


def test_the_ground_is_set_apart_and_the_flight_is_not():
    for flight in (FLIGHT, poses_only(FLIGHT), made_flight(mocap_hz=30.0, duration=24.0)):
        (first, second) = check_log(flight).exclude
        assert first[0] == pytest.approx(0.0, abs=0.02) and STAND < first[1] < STAND + 1.0
        assert 24.0 - STAND - 1.0 < second[0] < 24.0 - STAND
        assert second[1] == pytest.approx(24.0, abs=0.05)


def hover(place, seed):
    """Poses at (N, 3) places, one in 10 ms, level but for noise."""
    rng = np.random.default_rng(seed)
    t = 0.01 * np.arange(len(place))
    p = place + 2e-4 * rng.standard_normal(place.shape)
    q = np.column_stack([1e-3 * rng.standard_normal(place.shape), np.ones(t.size)])
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return FLIGHT.with_series({"position": Series(t, p), "attitude": Series(t, q)})


def low_hover(commands):
    """Hover at 0.35 m, so quiet that it seems to stand, then at 0.6 m; takes off and lands."""
    t = np.arange(0.0, 20.0, 0.01)
    height = 0.05 + np.interp(
        t, [1.5, 2.5, 11.0, 12.0, 17.0, 18.5], [0.0, 0.3, 0.3, 0.55, 0.55, 0.0]
    )
    log = hover(np.column_stack([0 * t, 0 * t, height]), 6)
    on = np.where((t > 1.4) & (t < 18.5), 400.0, 40.0)[:, None] + np.sin(np.outer(t, range(4)))
    return with_series(log, rotor_command=Series(t, on)) if commands else log


@pytest.mark.parametrize("commands", [True, False])
def test_a_low_hover_is_no_ground(commands):
    checked = check_log(low_hover(commands))
    (first, second) = checked.exclude
    assert 1.3 < first[1] < 2.0 and 18.0 < second[0] < 18.8
    assert not findings_by(checked, "set apart")


def test_much_airborne_time_set_apart_is_a_warning():
    imu = {name: FLIGHT.series[name] for name in ("gyro", "accel")}
    short = {n: Series(s.t[s.t < 15.0], s.values[s.t < 15.0]) for n, s in imu.items()}
    (said,) = findings_by(check_log(with_series(FLIGHT, **short)), "set apart")
    assert said.severity == "warning" and "s in the air are set apart" in said.message
    assert not findings_by(check_log(FLIGHT), "set apart")


def test_the_model_of_another_vehicle_is_refused():
    """A hover at 400 rad/s; the model's vehicle is nine times as heavy, or as heavy."""
    assert not findings_by(check_log(FLIGHT, Hover("ours", 1.3, 420.0)), "vehicle")
    with pytest.raises(
        InputError, match=r"carry 0\.1\d kg in flight, not 1\.3 kg.*another vehicle"
    ):
        check_log(FLIGHT, Hover("ours", 1.3, 1200.0))
    # a log that says its airframe is not held against ours
    foreign = replace(FLIGHT, airframe=Airframe("theirs", 0.1, 0.1, 0.05))
    assert not findings_by(check_log(foreign, Hover("ours", 1.3, 1200.0)), "vehicle")


@pytest.mark.parametrize("idle", [0.0, 80.0])
def test_a_log_cut_before_take_off_does_not_fly(idle):
    """Motors off or idling: no other vehicle, which "carries 0 kg"."""
    log = part_of(FLIGHT, end=STAND - 0.35)
    for channel in ("rotor_speed", "rotor_command"):
        log = with_values(log, channel, lambda s: s + idle)
    with pytest.raises(InputError, match=r"it does not fly.*cut before take-off") as refusal:
        check_log(log, Hover("ours", 1.3, 420.0))
    assert "another vehicle" not in str(refusal.value)


@pytest.mark.parametrize(
    ("change", "severity", "texts"),
    [
        (lambda s: s * 30.0 / np.pi, "fault", ("9.5", "rpm declared as rad/s")),
        (lambda s: s * 1.4, "warning", ("1.40 times",)),
        (lambda s: s * [1, 0, 1, 1], "fault", ("rear_left reads 0 in 100 %",)),
        (lambda s: s[:, [1, 0, 2, 3]], "fault", ("rear_left, front_right, front_left",)),
    ],
)
def test_rotor_speeds_against_commands(change, severity, texts):
    checked = check_log(with_values(FLIGHT, "rotor_speed", change))
    (said,) = wrote(checked, *texts)
    assert (said.check, said.severity) == ("rpm", severity)
    assert ("rotor_speed" in checked.series) == (severity == "warning")


def test_commands_in_another_order_are_told_by_the_gyro():
    """As a Crazyflie numbers its motors: clockwise from front right."""
    flight = with_series(FLIGHT, rotor_speed=None)
    checked = check_log(with_values(flight, "rotor_command", lambda s: s[:, [0, 3, 1, 2]]))
    assert "rotor_command" not in checked.series
    (said,) = findings_by(checked, "rpm")
    assert "front_right, rear_right, rear_left, front_left" in said.message

"""One body, one clock, commands that move: else it is corrected or left out, and said."""

import numpy as np
import pytest
from made_flight import made_flight, poses_only, with_series, with_values

from tombo_bag.channels import DRIVES
from tombo_bag.flight import RefusedLog, Series
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_logs.checks import check_log, findings_of

FLIGHT = made_flight()
POSE = ("position", "attitude")
GROUPS = (POSE, ("gyro", "accel"), ("rotor_command",), ("rotor_speed",), ("accel",))


def later(log, names, seconds):
    """The log with channels on a clock that is ahead by some seconds."""
    moved = {n: Series(log.series[n].t + seconds, log.series[n].values) for n in names}
    return with_series(log, **moved)


def keyed(findings, key):
    return [f for f in findings if f.key == key]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_another_clock_is_measured_and_corrected(seed):
    rng = np.random.default_rng(seed)
    group = GROUPS[seed % len(GROUPS)]
    offset = float(rng.uniform(0.35, 12.0) * rng.choice([-1.0, 1.0]))
    checked = check_log(later(made_flight(seed=seed), group, offset))
    (other,) = keyed(checked.findings, "other clock")
    assert other.channel == group[0] and other.numbers[0] == pytest.approx(offset, abs=0.1)
    moved = {n: checked.series[n].t for n in FLIGHT.series if n in checked.series}
    assert max(t[0] for t in moved.values()) - min(t[0] for t in moved.values()) < 0.2


def test_one_clock_is_left_as_it_is():
    checked = check_log(FLIGHT)
    assert not keyed(checked.findings, "other clock") and not keyed(
        checked.findings, "unknown clock"
    )
    assert np.array_equal(checked.series["gyro"].t, FLIGHT.series["gyro"].t)


def test_clocks_are_compared_whatever_the_axes():
    """Rates in FRD are another fault than a clock."""
    turned = with_values(FLIGHT, "gyro", lambda w: w * [1.0, -1.0, -1.0])
    assert not keyed(findings_of(turned), "other clock")


@pytest.mark.parametrize("apart", [0.3, 2.0])
def test_bodies_that_take_turns_are_refused(apart):
    """Every second pose is that of another body."""
    second = (np.arange(len(FLIGHT.series["position"].t)) % 2)[:, None]
    log = with_values(FLIGHT, "position", lambda p: p * (1 - second) + second * [apart, 0.0, 1.0])
    with pytest.raises(RefusedLog, match="two bodies or more take turns") as refused:
        check_log(log)
    assert refused.value.finding.key == "bodies" and refused.value.finding.channel == "position"
    assert findings_of(log)[-1] == refused.value.finding


def test_one_body_that_jumps_and_shakes_is_one():
    rng = np.random.default_rng(4)
    place = FLIGHT.series["position"].values.copy()
    place[700:] += [1.5, 0.0, 0.0]
    place[::37] += 0.5
    assert bodies_apart(place) == 0.0
    assert bodies_apart(0.05 * rng.standard_normal((2000, 3))) == 0.0


def test_commands_that_hold_nothing_in_the_air_are_left_out():
    constant = with_values(FLIGHT, "rotor_command", lambda s: np.full_like(s, 500.0))
    checked = check_log(with_series(constant, rotor_speed=None))
    (said,) = keyed(checked.findings, "constant")
    assert said.channel == "rotor_command" and not set(DRIVES) & set(checked.series)


def test_speeds_on_the_ground_before_the_first_command_are_no_fault():
    """An ESC reads 0 from power-on; commands are said from arming on."""
    command = FLIGHT.series["rotor_command"]
    armed = command.t > 1.2
    log = with_series(FLIGHT, rotor_command=Series(command.t[armed], command.values[armed]))
    checked = check_log(log)
    assert not keyed(checked.findings, "zeros") and "rotor_speed" in checked.series


@pytest.mark.parametrize(("share", "kept"), [(0.01, True), (0.1, False)])
def test_few_zeros_of_one_sensor_are_left_out_and_many_take_the_channel(share, kept):
    def lost(s):
        s[np.random.default_rng(2).random(len(s)) < share, 2] = 0.0
        return s

    checked = check_log(with_values(FLIGHT, "rotor_speed", lost))
    (said,) = keyed(checked.findings, "zeros")
    assert said.subject == "front_left" and said.numbers[0] == pytest.approx(share, rel=0.4)
    assert ("rotor_speed" in checked.series) == kept
    if kept:
        flown = checked.series["rotor_speed"]
        assert (flown.values[(flown.t > 5.0) & (flown.t < 15.0)] > 50.0).all()


def test_stamps_after_arrival_are_put_where_the_others_arrive():
    poses = poses_only(FLIGHT)
    late = {n: Series(s.t + 3.2, s.values, s.t + 0.01) for n, s in poses.series.items()}
    checked = check_log(poses.with_series(late))
    (said,) = keyed(checked.findings, "ahead of arrival")
    assert said.numbers[0] == pytest.approx(-3.19) and said.channel == "position"
    assert abs(checked.series["position"].t[0]) < 0.02


def test_a_scale_below_one_is_no_zero():
    """0.534 times its command begins like 0, and is another fault."""
    slow = with_values(FLIGHT, "rotor_speed", lambda s: s * [1.0, 1.0, 0.534, 1.0])
    checked = check_log(with_series(slow, rotor_command=None))
    (said,) = [f for f in checked.findings if f.check == "rpm"]
    assert said.key == "scale" and "rotor_speed" not in checked.series

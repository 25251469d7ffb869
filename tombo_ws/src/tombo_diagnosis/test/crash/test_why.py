"""The answer on a failed flight: on made-up logs and on real ones."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.crash.reason import name_cause, why, why_mapping
from tombo_diagnosis.crash.signs import Sign
from tombo_diagnosis.rotor_demand import MODES
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.readers.csv_mapping import load_mapping
from tombo_logs.readers.log_reader import read_log

DATA = Path(__file__).parents[6] / "shared" / "data"
CRAZYSWARM = Path(__file__).parents[5] / "examples" / "crazyswarm2.yaml"
AT, END = 4.0, 6.0


def hover(**changed):
    """A hover of 6 s at 1.5 m with noise; `changed`: channel → function of (t, values)."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, END, 0.01)
    values = {
        "position": np.column_stack([0.1 * np.sin(t), 0.1 * np.cos(t), 1.5 + 0.0 * t])
        + 0.0005 * rng.standard_normal((t.size, 3)),
        "attitude": np.tile([0.0, 0.0, 0.0, 1.0], (t.size, 1))
        + 0.001 * rng.standard_normal((t.size, 4)),
        "gyro": 0.02 * rng.standard_normal((t.size, 3)),
        "accel": [0.0, 0.0, GRAVITY] + 0.1 * rng.standard_normal((t.size, 3)),
        "rotor_command": 500.0 + 3.0 * rng.standard_normal((t.size, 4)),
    }
    for name, change in changed.items():
        values[name] = change(t, values[name])
    return Flight.measured("hover", "", {n: Series(t, np.array(v)) for n, v in values.items()})


def falling(t, position):
    since = np.clip(t - AT, 0.0, 0.5)
    return position - np.outer(0.5 * GRAVITY * since**2, [0.0, 0.0, 1.0])


def swinging(t, gyro):
    size = np.where(t > AT, 3.0 * np.minimum(t - AT, 1.0), 0.0)
    return gyro + np.outer(size * np.sin(2 * np.pi * 4.0 * t), [1.0, 0.0, 0.0])


def struck(t, accel):
    return accel + np.outer(60.0 * np.exp(-(((t - AT) / 0.015) ** 2)), [1.0, 0.0, 0.0])


def stopped(t, command):
    return np.where((t > AT)[:, None], 0.0, command)


def hold_pose(t, values):
    return np.where((t > AT)[:, None], values[np.argmax(t > AT)], values)


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        ({}, "none"),
        ({"position": falling, "rotor_command": stopped}, "kill"),
        ({"gyro": swinging}, "oscillation"),
        ({"accel": struck}, "contact"),
        ({"position": hold_pose, "attitude": hold_pose}, "loss_of_position"),
        ({"position": falling}, "unknown"),
    ],
)
def test_cause_and_time_of_what_goes_wrong(changed, cause):
    found = why(hover(**changed))
    assert found.cause == cause
    if cause == "none":
        assert found.time_s is None
    else:
        assert found.time_s == pytest.approx(
            AT, abs=0.2 if cause in ("oscillation", "unknown") else 0.1
        )
        assert found.timeline


def test_a_log_without_a_sign_may_be_of_a_mishap_that_leaves_none():
    """By Laplace 5 of 12 mishaps leave none in poses alone, 1 of 11 where more is measured."""
    log = hover()
    poses = log.with_series({name: log.series[name] for name in ("position", "attitude")})
    assert why(poses).confidence == pytest.approx(12.0 / 17.0)
    assert why(log).confidence == pytest.approx(11.0 / 12.0)


def turned_down_at_front_right(within_s, accel):
    """It turns by 3 rad/s, against what its rotors are asked for, which give less thrust."""
    turn = -3.0 * MODES[1:3, 0] / np.linalg.norm(MODES[1:3, 0])

    def since(t):
        return np.clip((t - AT) / within_s, 0.0, 1.0) * np.clip(
            1.0 - (t - AT - 0.3) / 0.2, 0.0, 1.0
        )

    def asked(t, command):
        more = np.array([0.1, 0.0, 0.0, 0.0]) - 0.1 * (MODES[1:3].T @ turn > 1.0)
        return command * np.sqrt(1.0 + np.outer(since(t), more))

    return hover(
        gyro=lambda t, w: w + np.outer(since(t), [*turn, 0.0]),
        rotor_command=asked,
        accel=lambda t, a: accel(t, a - np.outer(since(t), [0.0, 0.0, 1.0])),
    )


def test_the_turn_of_a_strike_is_no_lost_rotor():
    def rotors(log):
        return [s for s in why(log).timeline if s.kind == "rotor"]

    (lost,) = rotors(turned_down_at_front_right(0.2, lambda t, accel: accel))
    assert lost.time == pytest.approx(AT, abs=0.1)
    assert not rotors(turned_down_at_front_right(0.02, struck))


def test_what_the_checks_doubt_is_said_and_stated_lower():
    log = hover(gyro=swinging)
    doubted = log.with_series(
        {**log.series, "rotor_command": Series(log.series["gyro"].t, np.full((600, 4), 500.0))}
    )
    found = why(doubted)
    said = [f for f in why_mapping(found)["findings"] if f["key"] == "constant"]
    assert said and said[0]["channel"] == "rotor_command" and said[0]["severity"] == "fault"
    assert found.confidence <= why(log).confidence


def test_what_follows_an_impact_is_no_cause():
    line = [Sign(5.0, "impact", ""), Sign(5.02, "position", "", np.inf)]
    assert name_cause(line)[0] == "unknown"
    line = [Sign(4.0, "position", "", np.inf), Sign(5.0, "impact", "")]
    assert name_cause(line)[:2] == ("loss_of_position", 4.0)


def test_a_log_without_positions_is_refused():
    log = hover()
    without = log.with_series({n: s for n, s in log.series.items() if n != "position"})
    with pytest.raises(InputError, match="needed to say why it crashed: position"):
        why(without)


def real(path, mapping):
    path = DATA / path
    if not path.is_file():
        pytest.skip(f"no {path}")
    return why(read_log(path, path.name, mapping))


@pytest.mark.slow
def test_the_flip_of_a_real_crash_is_timed():
    found = real("crazyswarm2/log28.csv.gz", load_mapping(CRAZYSWARM))
    assert found.cause in ("unknown", "oscillation")
    assert found.time_s == pytest.approx(6.6, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("log", ["log45", "log113", "log119", "log146", "log149"])
def test_real_oscillations_are_named(log):
    found = real(f"crazyswarm2/{log}.csv.gz", load_mapping(CRAZYSWARM))
    assert found.cause == "oscillation"


@pytest.mark.slow
@pytest.mark.parametrize(
    "log", ["flights/B10_lissajous_fast_rep1", "flights/B2_circle_fast_rep1",
            "flights/B3_figure8_fast_rep1", "nanobench_controllers/mell_aligned"],
)  # fmt: skip
def test_nothing_is_wrong_with_healthy_flights(log):
    found = real(f"{log}.csv.gz", load_mapping("nanobench"))
    assert found.cause == "none" and found.time_s is None


def landed(touch_m):
    """A take-off to 0.5 m, a dip to `touch_m` above the floor at 5 s, and a landing at 8 s."""
    t = np.arange(0.0, 10.0, 0.02)
    corners = [0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0]
    heights = [0.0, 0.0, 0.5, 0.45, touch_m, 0.3, 0.25, 0.0, 0.0]
    height = PchipInterpolator(corners, heights)(t)  # smooth, without overshoot
    noise = 0.0001 * np.random.default_rng(5).standard_normal((t.size, 3))
    place = np.column_stack([0.1 * t, 0.0 * t, height]) + noise
    return Flight.measured("landed", "", {"position": Series(t, place)})


def test_a_touch_of_the_ground_is_where_it_rests_later():
    touched = why(landed(0.0))
    assert touched.cause == "contact" and touched.time_s == pytest.approx(5.0, abs=0.1)
    assert why(landed(0.01)).cause == "none"

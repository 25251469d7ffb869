"""From lift-off on, poses must move as PX4's tilt drives the vehicle; else it lands."""

import math
import re

import numpy as np
import pytest

from tombo_px4.bridge.flight_watch import TakeoffWatch, accelerations_by_position

MS = 1_000_000
GRAVITY = 9.80665


def turned(degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def fly(axes, seconds=3.0, lean=0.05, rate_hz=50, noise_m=0.0007, closed=True, after_s=0.0):
    """Take off with a set point at the origin; return the watch, how far it got, and up [m].

    A point mass climbs; a position loop tilts it against the distance that the poses show. It
    ends `after_s` after the watch has decided.
    """
    rng = np.random.default_rng(4)
    watch = TakeoffWatch()
    watch.begin()
    place, speed = np.array([0.01, -0.01, 0.18]), np.array([0.02, 0.01, 0.0])
    shown_before = axes @ place
    farthest, end = 0.0, round(seconds * 1000)
    for k in range(round((seconds + after_s) * 1000)):
        push = np.zeros(3)
        if k > end:
            break
        shown = watch.as_px4_feels(k * 1_000_000, axes @ place)
        farthest = max(farthest, float(np.linalg.norm(place[:2])))
        if k > 300:  # lifts off
            rate = (shown - shown_before) * 1e3
            if closed:
                push[:2] = np.clip(-1.0 * shown[:2] - 1.5 * rate[:2], -2.0, 2.0)
            push[0] += lean * GRAVITY * math.sin(4.0 * k * 1e-3)
            push[1] += lean * GRAVITY * math.cos(3.0 * k * 1e-3)
            push[2] = 1.0 - speed[2]
        shown_before = shown
        speed, place = speed + push * 1e-3, place + speed * 1e-3
        if k % 10 == 0:
            force = push + np.array([0.0, 0.0, GRAVITY]) + rng.normal(0.0, 0.1, 3)
            watch.felt(k * MS, np.array([0.0, 0.0, 0.0, 1.0]), force)
        if k % (1000 // rate_hz) == 0:
            watch.pose(k * MS, axes @ place + rng.normal(0.0, noise_m, 3))
            known = bool(watch.mistake)
            if (watch.judge() and not known) or watch.confirmed:
                end = k + round(after_s * 1000)
    return watch, farthest, float(place[2])


@pytest.mark.parametrize("rate_hz", [30, 50, 100])
@pytest.mark.parametrize("degrees", [0.0, 8.0, -8.0])
def test_right_axes_are_confirmed(degrees, rate_hz):
    watch, _, _ = fly(turned(degrees), seconds=8.0, rate_hz=rate_hz)
    assert watch.mistake == "" and watch.confirmed


@pytest.mark.parametrize("degrees", [60, 90, -90, 135, 180])
def test_a_turned_body_is_found_within_the_first_metre(degrees):
    watch, away, height = fly(turned(degrees))
    assert "is not the nose" in watch.mistake
    named_degrees = int(re.search(r"move ([+-]\d+) deg", watch.mistake)[1])
    assert abs((named_degrees - degrees + 180) % 360 - 180) < 25
    assert away < 0.3 and height < 1.2


@pytest.mark.parametrize("axes", [turned(90), turned(180), turned(-135), np.diag([1, -1, 1])])
def test_with_the_positions_turned_back_it_stays_where_it_is(axes):
    watch, away, _ = fly(axes, lean=0.03, after_s=4.0)
    assert watch.mistake and away < 0.5


def test_heights_that_are_upside_down_are_found_while_it_climbs():
    watch, _, height = fly(np.diag([1.0, 1.0, -1.0]))
    assert "z is upside down" in watch.mistake and height < 0.6


def test_a_vehicle_that_hangs_still_is_not_judged():
    watch, _, _ = fly(turned(90), seconds=2.0, lean=0.0, noise_m=0.001, closed=False)
    assert watch.mistake == "" and not watch.confirmed


def test_second_differences_are_those_of_the_acceleration():
    t = np.linspace(0.0, 3.0, 151)
    position = np.stack([0.1 * np.sin(3.0 * t), 0.5 * t**2, 4.0 * t], axis=1)
    fast = np.linspace(0.0, 3.0, 601)
    acceleration = np.stack(
        [-0.9 * np.sin(3.0 * fast), np.ones_like(fast), np.zeros_like(fast)], axis=1
    )
    seen, felt = accelerations_by_position(t, position, fast, acceleration)
    assert len(seen) > 100
    np.testing.assert_allclose(seen, felt, atol=2e-4)


def test_spans_with_a_gap_are_left_out():
    t = np.concatenate([np.linspace(0.0, 1.0, 51), np.linspace(1.5, 2.5, 51)])
    position = np.stack([t, t, t], axis=1)
    seen, _ = accelerations_by_position(t, position, t, np.zeros_like(position))
    whole, _ = accelerations_by_position(
        np.linspace(0.0, 2.5, 126), np.zeros((126, 3)), t, np.zeros_like(position)
    )
    assert 0 < len(seen) < len(whole) - 30

"""The reference along a leg: continuous, monotone, exact in length, its own derivative."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tombo_control.planning.leg import leg_position, straight_leg, trapezoidal_profile

durations = st.floats(0.1, 100.0)
shares = st.one_of(st.just(0.0), st.floats(1e-3, 0.5))


def sampled(duration, ramp, n=2001):
    t = np.linspace(-0.1 * duration, 1.1 * duration, n)
    return t, *np.array([trapezoidal_profile(x, duration, ramp) for x in t]).T


@pytest.mark.slow
@given(durations, st.floats(0.05, 0.5))
def test_speed_is_the_slope_of_the_way_and_acceleration_that_of_speed(duration, share):
    ramp = share * duration
    t, way, speed, change = sampled(duration, ramp)
    step = t[1] - t[0]
    assert np.abs(np.diff(way) / step - 0.5 * (speed[1:] + speed[:-1])).max() < step / ramp
    assert np.abs(np.diff(speed)).max() <= step / ramp + 1e-9  # no jump anywhere
    inner = np.abs(change[1:] - change[:-1]) < 1e-12  # away from the corners of the profile
    slope = np.diff(speed) / step
    assert np.allclose(slope[inner], change[1:][inner], atol=1e-6 / ramp)


points = st.tuples(*[st.floats(-50.0, 50.0)] * 3)


@pytest.mark.slow
@given(points, points, st.floats(0.05, 8.0), st.floats(0.0, 1e4))
def test_a_straight_leg_ends_at_its_goal_and_keeps_its_speed(start, goal, speed, now):
    leg = straight_leg(start, goal, speed, now)
    assert leg_position(leg, now) == pytest.approx(start, abs=1e-9)
    assert leg_position(leg, now + 1e7) == pytest.approx(goal, abs=1e-6)
    assert np.linalg.norm(leg.velocity) <= speed * (1.0 + 1e-9)
    length = np.linalg.norm(np.subtract(goal, start))
    assume(length > 1.5 * speed**2 / 0.8)  # long enough to reach the speed
    assert np.linalg.norm(leg.velocity) == pytest.approx(speed)
    assert leg.end_s - leg.begin_s == pytest.approx(length / speed + speed / 0.8, rel=1e-6)

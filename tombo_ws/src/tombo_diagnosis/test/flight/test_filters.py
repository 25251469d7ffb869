"""The one filter of both sides of an equation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_bag.flight import Series
from tombo_diagnosis.flight.fit.track import clear_rows, gaussian
from tombo_logs.checks.even_flight import held_means, resample

TICK = 0.004
T = 3.0 + TICK * np.arange(400)
KERNEL_WIDTHS = st.floats(0.01, 0.1)
SHORT = st.floats(-2.0, 2.0)


@pytest.mark.slow
@given(KERNEL_WIDTHS, SHORT, SHORT, SHORT)
def test_value_slope_and_curvature_of_a_parabola_are_exact(width, a, b, c):
    """The mean of a parabola is its value and its curvature times half the kernel's variance."""
    kernel = gaussian(T, width, 0.02)
    x = a + b * (T - 3.8) + 0.5 * c * (T - 3.8) ** 2
    at = kernel.t - 3.8
    assert kernel.slope @ x == pytest.approx(b + c * at, abs=1e-7)
    assert kernel.curvature @ x == pytest.approx(np.full(at.size, c), abs=1e-5)
    assert kernel.smooth @ (a + b * (T - 3.8)) == pytest.approx(a + b * at, abs=1e-9)


@pytest.mark.slow
@given(KERNEL_WIDTHS, st.floats(0.2, 1.5), st.floats(0.0, 6.0))
def test_curvature_of_the_position_is_the_filtered_acceleration(width, frequency, phase):
    """Both sides pass through one kernel: smoothing costs resolution but adds next to no error."""
    kernel = gaussian(T, width, 0.02)
    w = 2.0 * np.pi * frequency
    x = np.sin(w * T + phase)
    speed, acceleration = w * np.cos(w * T + phase), -w * w * x
    assert kernel.curvature @ x == pytest.approx(kernel.smooth @ acceleration, abs=5e-3 * w * w)
    assert kernel.slope @ x == pytest.approx(kernel.smooth @ speed, abs=5e-3 * w)


@given(st.integers(0, T.size - 1), st.integers(1, 50), KERNEL_WIDTHS)
def test_clear_rows_are_those_that_nothing_spoiled_reaches(first, count, width):
    kernel = gaussian(T, width, 0.02)
    spoiled = np.zeros(T.size, bool)
    spoiled[first : first + count] = True
    x = np.zeros(T.size)
    clear = clear_rows(kernel, spoiled)
    x[spoiled] = 1e9
    assert not (kernel.smooth @ x)[clear].any()
    assert not (kernel.curvature @ x)[clear].any()
    bad = T[spoiled]
    near = [np.abs(bad - t).min() <= kernel.reach + 1e-9 for t in kernel.t]
    assert np.array_equal(clear, ~np.array(near))


STAMPS = st.lists(st.floats(0.0005, 0.0035), min_size=150, max_size=150)


def uneven(steps, seed):
    t = np.concatenate([[0.0], np.cumsum(steps)])
    values = np.random.default_rng(seed).standard_normal((t.size, 2))
    return t, values, np.arange(0.02, t[-1] - 0.02, TICK)


@pytest.mark.slow
@given(STAMPS, st.integers(0, 2**32 - 1))
def test_means_over_ticks_keep_the_integral(steps, seed):
    """Of a series sampled at uneven times, taken to be straight in between."""
    t, values, ticks = uneven(steps, seed)
    edge = ticks[0] - 0.5 * TICK, ticks[-1] + 0.5 * TICK
    fine = np.unique(np.concatenate([t[(t > edge[0]) & (t < edge[1])], edge]))
    for column, means in zip(values.T, resample(Series(t, values), ticks).T, strict=True):
        area = np.cumsum(np.concatenate([[0.0], 0.5 * (column[1:] + column[:-1]) * np.diff(t)]))
        # The means take the area to be straight between stamps: only the ends differ.
        exact = np.interp(edge[1], t, area) - np.interp(edge[0], t, area)
        assert means.sum() * TICK == pytest.approx(exact, abs=1e-9)
        assert np.trapezoid(np.interp(fine, t, column), fine) == pytest.approx(exact, abs=0.02)


@pytest.mark.slow
@given(STAMPS, st.integers(0, 2**32 - 1))
def test_means_of_what_is_held_keep_the_integral(steps, seed):
    t, values, ticks = uneven(steps, seed)
    begin, end = ticks[0], ticks[-1] + TICK
    bounds = np.clip(np.concatenate([t, [end]]), begin, end)
    means = held_means(ticks, t, values)
    assert means.sum(axis=0) * TICK == pytest.approx(np.diff(bounds) @ values, abs=1e-9)
    assert means.min() >= values.min() - 1e-9 and means.max() <= values.max() + 1e-9

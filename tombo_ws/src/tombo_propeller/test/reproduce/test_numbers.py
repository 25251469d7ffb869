"""The numbers behind the claims: printed digits, optima, and the universal curve."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_dynamics.propeller import RPM, configuration, speed_of_maximum_thrust
from tombo_propeller.reproduce.claims.model_claims import draws, reading_deg, weighted_slope
from tombo_propeller.reproduce.computed_values import maximum
from tombo_propeller.reproduce.paper_values import PrintedNumber, read_paper


@given(st.integers(-99_999, 99_999), st.integers(0, 4), st.floats(-0.49, 0.49))
def test_printed_digits_agree_within_half_of_the_last(n: int, digits: int, off: float) -> None:
    text = f"{n / 10**digits:.{digits}f}"
    assert PrintedNumber(text).agrees((n + off) / 10**digits) or n == 0
    assert not PrintedNumber(text).agrees((n + 1.0 + off) / 10**digits)


def test_a_printed_zero_counts_as_a_digit() -> None:
    row = read_paper().table_3[12]
    assert (row.ratio.text, row.ratio.digits, row.ratio.half) == ("1.8990", 4, 5e-5)
    assert not row.ratio.agrees(1.8993)
    assert PrintedNumber("1.899").agrees(1.8993)


@pytest.mark.parametrize("law", ["published", "repaired"])
@pytest.mark.parametrize("conf", [1, 8, 13])
def test_maximum_of_thrust_is_where_the_library_has_it(conf: int, law: str) -> None:
    computed = maximum(configuration(conf), law, "thrust_N")
    assert computed.inside
    expected, _ = speed_of_maximum_thrust(configuration(conf), law)
    assert computed.speed_rpm == pytest.approx(expected / RPM, rel=1e-6)


@given(st.floats(0.0, 30.0), st.floats(1.0, 30.0))
def test_reading_of_the_flap_is_exact_without_lag_and_never_low_with_it(
    alpha: float, beta: float
) -> None:
    assert reading_deg(0.0, beta) == pytest.approx(beta, abs=1e-5)
    seen = reading_deg(alpha, beta)
    length, inner = 0.1111 - 0.035, 0.035
    radius = inner + length * math.cos(math.radians(seen))
    a, b = math.radians(alpha), math.radians(beta)
    true = math.hypot(
        inner + length * math.cos(a) * math.cos(b), length * math.sin(a) * math.cos(b)
    )
    assert radius == pytest.approx(true, abs=1e-9)
    assert seen >= beta - 1e-5


def test_weighted_slope_knows_its_error() -> None:
    x, deviation = np.linspace(0.5, 0.7, 9), np.linspace(0.03, 0.2, 9)
    computed = [weighted_slope(x, y, deviation) for y in draws(2.0 * x, deviation)[:4000]]
    slopes, error = np.array([s for s, _ in computed]), computed[0][1]
    assert slopes.mean() == pytest.approx(2.0, abs=4.0 * error / math.sqrt(4000))
    assert slopes.std() == pytest.approx(error, rel=0.05)

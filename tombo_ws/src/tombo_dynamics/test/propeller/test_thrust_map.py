import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.propeller import LAWS, SPEED_LIMIT, configuration, evaluate, thrust_map
from tombo_dynamics.propeller.cubic import cubic_table, cubic_values
from tombo_dynamics.propeller.thrust_map import map_speed, map_thrust, map_torque

EACH = pytest.mark.parametrize(("conf", "law"), [(c, law) for law in LAWS for c in range(14)])
CONF = st.integers(0, 13)
LAW = st.sampled_from(list(LAWS))
SHARE = st.floats(0.0, 1.0)


def inverse(m, thrust: float) -> float:
    return map_speed(m.speed_coeffs, 1 / m.d_root, m.thrust_coeffs, 1 / m.d_omega, thrust)


@EACH
def test_map_is_the_model(conf: int, law: str) -> None:
    m = thrust_map(configuration(conf), law)
    speeds = np.linspace(0.0, m.omega_max, 1001)
    points = evaluate(configuration(conf), speeds, law)
    assert np.abs(m.thrust(speeds) - points.thrust_N).max() < 2e-6 * m.thrust_max
    assert np.abs(m.torque(speeds) - points.torque_Nm).max() < 2e-6 * points.torque_Nm.max()


@EACH
def test_thrust_and_torque_rise_all_the_way(conf: int, law: str) -> None:
    m = thrust_map(configuration(conf), law)
    speeds = np.linspace(0.0, m.omega_max, 20_001)
    assert (np.diff(m.thrust(speeds)) > 0.0).all()
    assert (np.diff(m.torque(speeds)) > 0.0).all()
    assert m.omega_max == pytest.approx(0.9 * m.omega_mtf, rel=1e-12)
    assert float(m.thrust(m.omega_max)) == pytest.approx(m.thrust_max, rel=1e-12)


@pytest.mark.slow
@settings(deadline=None)
@given(conf=CONF, law=LAW, share=SHARE)
def test_speed_for_thrust_and_back(conf: int, law: str, share: float) -> None:
    m = thrust_map(configuration(conf), law)
    speed = share * m.omega_max
    assert float(m.speed_for_thrust(m.thrust(speed))) == pytest.approx(speed, abs=2e-5)
    thrust = share * m.thrust_max
    assert float(m.thrust(m.speed_for_thrust(thrust))) == pytest.approx(
        thrust, rel=1e-6, abs=1e-9 * m.thrust_max
    )


@pytest.mark.slow
@settings(deadline=None)
@given(conf=CONF, law=LAW, a=SHARE, b=SHARE)
def test_inverse_is_monotone(conf: int, law: str, a: float, b: float) -> None:
    m = thrust_map(configuration(conf), law)
    low, high = sorted((a, b))
    if high - low > 1e-6:
        assert inverse(m, low * m.thrust_max) < inverse(m, high * m.thrust_max)


def test_no_maximum_is_said() -> None:
    for conf, law in ((0, "repaired"), (13, "consistent")):
        m = thrust_map(configuration(conf), law)
        assert not m.has_maximum
        assert m.omega_mtf == SPEED_LIMIT
    assert thrust_map(configuration(13)).has_maximum


@pytest.mark.parametrize("conf", [0, 1, 13])
def test_compiled_functions_clamp(conf: int) -> None:
    m = thrust_map(configuration(conf))
    inv = 1 / m.d_omega
    for table, end in (
        (m.thrust_coeffs, float(m.thrust(m.omega_max))),
        (m.torque_coeffs, float(m.torque(m.omega_max))),
    ):
        assert map_thrust(table, inv, -5.0) == table[0, 0] == 0.0
        for beyond in (m.omega_max, 1.01 * m.omega_max, 1e12, math.inf):
            assert map_thrust(table, inv, beyond) == pytest.approx(end, rel=1e-12)
        assert math.isnan(map_torque(table, inv, math.nan))
    assert inverse(m, -1.0) == inverse(m, 0.0) == 0.0
    for beyond in (m.thrust_max, 2.0 * m.thrust_max, math.inf):
        assert inverse(m, beyond) == pytest.approx(m.omega_max, rel=1e-9)
    assert math.isnan(inverse(m, math.nan))


@compiled
def _sum_inside(coeffs, inverse_step, speeds):
    total = 0.0
    for i in range(speeds.shape[0]):
        total += map_thrust(coeffs, inverse_step, speeds[i])
    return total


def test_usable_inside_other_compiled_code() -> None:
    m = thrust_map(configuration(13))
    speeds = np.linspace(0.0, m.omega_max, 50)
    total = _sum_inside(m.thrust_coeffs, 1 / m.d_omega, speeds)
    assert total == pytest.approx(m.thrust(speeds).sum(), rel=1e-12)


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf, 1e9])
def test_methods_refuse_what_is_outside(bad: float) -> None:
    m = thrust_map(configuration(13))
    for method in (m.thrust, m.torque, m.speed_for_thrust):
        with pytest.raises(InputError, match=r"accepted: 0 to"):
            method([1.0, bad])


@pytest.mark.slow
@settings(deadline=None)
@given(
    values=st.lists(st.floats(0.0, 10.0), min_size=3, max_size=12),
    slopes=st.lists(st.floats(-50.0, 50.0), min_size=12, max_size=12),
)
def test_cubics_are_monotone_between_rising_knots_whatever_the_slopes(
    values: list[float], slopes: list[float]
) -> None:
    rising = np.cumsum(np.array(values) + 0.01)
    table = cubic_table(0.5, rising, np.array(slopes[: len(rising)]))
    x = np.linspace(0.0, 0.5 * (len(rising) - 1), 400)
    y = cubic_values(table, 0.5, x)
    assert (np.diff(y) >= -1e-9).all()
    assert cubic_values(table, 0.5, 0.5 * np.arange(len(rising))) == pytest.approx(rising)

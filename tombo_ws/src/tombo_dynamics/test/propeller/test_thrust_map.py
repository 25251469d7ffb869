import numpy as np
import pytest

from tombo_dynamics.propeller import LAWS, SPEED_LIMIT, configuration, evaluate, thrust_map

EACH = pytest.mark.parametrize(("conf", "law"), [(c, law) for law in LAWS for c in range(14)])


@EACH
def test_the_map_gives_thrust_and_torque_of_the_model(conf: int, law: str) -> None:
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


def test_missing_maximum_is_reported() -> None:
    for conf, law in ((0, "repaired"), (13, "consistent")):
        m = thrust_map(configuration(conf), law)
        assert not m.has_maximum
        assert m.omega_mtf == SPEED_LIMIT
    assert thrust_map(configuration(13)).has_maximum

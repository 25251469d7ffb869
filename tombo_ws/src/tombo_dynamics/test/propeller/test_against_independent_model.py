import math

import independent_propeller as other
import numpy as np
import pytest

from tombo_dynamics.propeller import configuration, evaluate, parameter_row, valid_speed
from tombo_dynamics.propeller.laws.equilibrium import newton
from tombo_dynamics.propeller.laws.parameters import LAWS, unpack

RPM = math.pi / 30.0


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("conf", range(14))
def test_agrees_with_quadrature_and_general_root_finder(conf: int, law: str) -> None:
    chosen = configuration(conf)
    speeds = valid_speed(chosen, law) * np.array([0.07, 0.25, 0.5, 0.7, 0.98])
    points = evaluate(chosen, speeds, law)
    for i, speed in enumerate(speeds):
        for name, value in other.solve(conf, float(speed), law).items():
            assert getattr(points, name)[i] == pytest.approx(value, rel=1e-6, abs=1e-9), name


@pytest.mark.parametrize("law", ["repaired", "consistent"])
def test_jacobian_is_that_of_the_equations(law: str) -> None:
    speed, p = 600.0, unpack(parameter_row(configuration(13), law))
    alpha, beta, gamma, determinant, found, *tangent = newton(
        LAWS[law], p, speed**2, 0.1, 0.1, 0.1, 1e-9
    )
    assert found
    x, h = np.array([alpha, beta, gamma]), 1e-5
    columns = [
        (
            other.residual(13, speed, law, tuple(x + d))
            - other.residual(13, speed, law, tuple(x - d))
        )
        / (2.0 * h)
        for d in h * np.eye(3)
    ]
    assert determinant == pytest.approx(np.linalg.det(np.stack(columns, axis=1)), rel=1e-5)
    ahead, behind = (evaluate(configuration(13), k * speed, law) for k in (1.001, 0.999))
    for name, slope in zip(("alpha_rad", "beta_rad", "gamma_rad"), tangent, strict=True):
        rise = float(getattr(ahead, name) - getattr(behind, name))
        assert slope == pytest.approx(rise / math.log((1.001 / 0.999) ** 2), rel=1e-5)

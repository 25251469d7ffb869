import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_dynamics.propeller import (
    LAWS,
    SCALARS,
    SPEED_LIMIT,
    configuration,
    configurations,
    evaluate,
    evaluate_rows,
    parameter_row,
    parameter_rows,
)
from tombo_dynamics.propeller.laws.equilibrium import equilibrium, newton, spring_angle
from tombo_dynamics.propeller.laws.parameters import unpack

VARIED = ("flap_compliance", "lag_compliance", "twist_compliance", "wing_weight", "centrifugal")
VARIED += ("lift_arm", "drag_arm", "air_density", "flap_offset", "lag_offset")


def random_rows(law: str, count: int, seed: int, spread: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    base = np.stack([parameter_row(c, law) for c in configurations() if not c.rigid])
    rows = base[rng.integers(0, len(base), count)].copy()
    for name in VARIED:
        rows[:, SCALARS[name]] *= spread ** rng.uniform(-1.0, 1.0, count)
    return rows


def followed(law: str, row: np.ndarray, speed: float) -> tuple[np.ndarray, bool]:
    """The root from rest in short steps of omega^2, each from the last root, and whether it is."""
    p, square = unpack(row), speed**2
    weight = p.wing_weight * p.joint_radius / p.wing_centroid
    x = np.array(
        [0.0, -p.flap_compliance * weight, -p.twist_compliance * p.wing_weight * p.lift_arm]
    )
    here, step = 0.0, square / 64.0
    while here < square and step > 1e-8 * square:
        there = min(square, here + step)
        *new, determinant, found, _, _, _ = newton(LAWS[law], p, there, *x, 1e-9)
        if found and determinant > 0.0 and np.abs(new - x).max() < 0.03:
            x, here, step = np.array(new), there, min(1.5 * step, square / 64.0)
        else:
            step *= 0.5
    return x, here >= square


@pytest.mark.slow
@pytest.mark.parametrize("law", ["repaired", "consistent"])
def test_finds_the_root_that_continues_the_one_at_rest(law: str) -> None:
    rows = random_rows(law, 400, seed=1, spread=3.0)
    speeds = np.random.default_rng(2).uniform(0.0, SPEED_LIMIT, len(rows))
    verdicts = set()
    for row, speed in zip(rows, speeds, strict=True):
        *angles, verdict = equilibrium(LAWS[law], unpack(row), speed**2)
        path, reached = followed(law, row, speed)
        verdicts.add(verdict)
        assert np.isfinite(angles).all() == reached
        if reached:
            assert angles == pytest.approx(path, abs=1e-9)
    assert verdicts == {0, 1}  # in range, never lost; beyond it, twisted too far


# Somewhat heavy, its joint narrow: the wing twists nose up and snaps over. Newton's method from a
# fixed start finds the equilibrium on the far side of that.
SNAPPING = {"matrix_modulus_MPa": 0.45, "poisson_ratio": 0.31, "length_mm": 4.9, "fibres": 3}
SNAPPING |= {"fibre_diameter_mm": 0.26, "fibre_shear_modulus_MPa": 34.0, "lift_arm_mm": 1.4}
SNAPPING |= {"fibre_youngs_modulus_MPa": 600.0, "flap_second_moment_mm4": 660.0}
SNAPPING |= {"lag_second_moment_mm4": 2300.0, "torsion_constant_m4": 3.2e-10}
SNAPPING |= {"outer_radius_m": 0.053, "wing_mass_kg": 0.01, "wing_centroid_m": 0.082}
SNAPPING |= {"drag_arm_mm": -0.79, "flap_offset_rad": 0.038, "lag_offset_rad": -0.018}
SNAPPING |= {"air_density_kg_m3": 0.93}


@pytest.mark.slow
def test_a_root_beyond_a_turning_point_is_none() -> None:
    speeds = np.linspace(0.0, SPEED_LIMIT, 20_001)
    row = parameter_rows(13, "repaired", **SNAPPING)
    points = evaluate_rows(row, speeds, "repaired")
    lost = points.verdict == 2
    assert lost.any()
    assert not points.valid[np.argmax(lost) :].any()  # once the path has turned back, for good
    assert np.abs(np.diff(points.gamma_rad[points.valid])).max() < 0.05
    beyond = [
        newton(LAWS["repaired"], unpack(row), w**2, 0.1, 0.1, 0.1, 1e-9) for w in speeds[lost]
    ]
    assert any(found and determinant > 0.0 for _, _, _, determinant, found, *_ in beyond)


@pytest.mark.parametrize("law", LAWS)
def test_one_call_with_many_rows_is_many_calls(law: str) -> None:
    rows = random_rows(law, 200, seed=3, spread=1.5)
    speeds = np.random.default_rng(4).uniform(0.0, SPEED_LIMIT, 200)
    together = evaluate_rows(rows, speeds, law)
    for i in range(200):
        alone = evaluate_rows(rows[i], speeds[i], law)
        assert alone.valid == together.valid[i]
        # the same to rounding: vectorised loops may fuse a multiplication and an addition
        for name in ("thrust_N", "gamma_rad"):
            one, many = getattr(alone, name), getattr(together, name)[i]
            np.testing.assert_allclose(one, many, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("law", LAWS)
def test_result_depends_on_the_speed_alone_not_on_its_neighbours(law: str) -> None:
    speeds = np.linspace(0.0, 690.0, 101)
    rising = evaluate(configuration(5), speeds, law).thrust_N
    falling = evaluate(configuration(5), speeds[::-1], law).thrust_N
    assert (rising == falling[::-1]).all()


@pytest.mark.slow
@settings(deadline=None)
@given(m=st.just(0.0) | st.floats(1e-6, 1e4), r=st.floats(-1e3, 1e3))
def test_spring_angle_solves_its_equation(m: float, r: float) -> None:
    y = spring_angle(m, r)
    if m == 0.0:
        assert y == r
        return
    assert abs(y) < np.pi / 2
    low, high = ((v + m * np.tan(v)) for v in (y - 2e-14, y + 2e-14))
    assert low <= r <= high

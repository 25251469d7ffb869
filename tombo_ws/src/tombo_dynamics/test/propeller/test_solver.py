from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_dynamics.propeller import (
    LAWS,
    SCALARS,
    SPEED_LIMIT,
    Configuration,
    Fibre,
    Matrix,
    Nodus,
    Surroundings,
    configuration,
    configurations,
    evaluate_rows,
    parameter_row,
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
SILICONE = Matrix("soft", 0.31, (1.0, 2.0, 3.0, 4.0), (0.45, 0.45, 0.45, 0.45))
SNAPPING = Nodus(SILICONE, Fibre("weak", 600.0, 34.0), 3, 0.26, 4.9)
JOINT = {"flap_second_moment_mm4": 660.0, "lag_second_moment_mm4": 2300.0, "lift_arm_mm": 1.4}
JOINT |= {"torsion_constant_m4": 3.2e-10, "outer_radius_m": 0.053, "wing_mass_kg": 0.01}
JOINT |= {"wing_centroid_m": 0.082, "drag_arm_mm": -0.79, "flap_offset_rad": 0.038}
JOINT |= {"lag_offset_rad": -0.018}


def snapping() -> Configuration:
    blade = configuration(13).blade
    return Configuration(99, replace(blade, joint=replace(blade.joint, **JOINT)), SNAPPING)


@pytest.mark.slow
def test_a_root_beyond_a_turning_point_is_none() -> None:
    speeds = np.linspace(0.0, SPEED_LIMIT, 20_001)
    row = parameter_row(snapping(), "repaired", Surroundings(air_density_kg_m3=0.93))
    points = evaluate_rows(row, speeds, "repaired")
    lost = points.verdict == 2
    assert lost.any()
    assert not points.valid[np.argmax(lost) :].any()  # once the path has turned back, for good
    assert np.abs(np.diff(points.gamma_rad[points.valid])).max() < 0.05
    beyond = [
        newton(LAWS["repaired"], unpack(row), w**2, 0.1, 0.1, 0.1, 1e-9) for w in speeds[lost]
    ]
    assert any(found and determinant > 0.0 for _, _, _, determinant, found, *_ in beyond)


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

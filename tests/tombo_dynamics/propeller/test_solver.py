import time

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
)
from tombo_dynamics.propeller.laws.equilibrium import equilibrium, follow
from tombo_dynamics.propeller.laws.parameters import unpack
from tombo_dynamics.propeller.laws.spring import spring_angle

VARIED = ("flap_compliance", "lag_compliance", "twist_compliance", "wing_weight", "centrifugal")
VARIED += ("lift_arm", "drag_arm", "air_density", "flap_offset", "lag_offset")


def random_rows(law: str, count: int, seed: int, spread: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    base = np.stack([parameter_row(c, law) for c in configurations() if not c.rigid])
    rows = base[rng.integers(0, len(base), count)].copy()
    for name in VARIED:
        rows[:, SCALARS[name]] *= spread ** rng.uniform(-1.0, 1.0, count)
    return rows


@pytest.mark.parametrize("law", ["repaired", "consistent"])
def test_finds_the_root_that_continues_the_one_at_rest(law: str) -> None:
    rows = random_rows(law, 3000, seed=1, spread=3.0)
    speeds = np.random.default_rng(2).uniform(0.0, SPEED_LIMIT, len(rows))
    verdicts = set()
    for row, speed in zip(rows, speeds, strict=True):
        p = unpack(row)
        *angles, verdict = equilibrium(LAWS[law], p, speed**2)
        *path, path_verdict = follow(LAWS[law], p, speed**2)
        assert verdict == path_verdict
        verdicts.add(verdict)
        if verdict == 0:
            assert angles == pytest.approx(path, abs=1e-9)
    assert verdicts == {0, 1}  # in range, never lost; beyond it, twisted too far


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


def test_rows_and_speeds_broadcast() -> None:
    rows = np.stack([parameter_row(configuration(n), "repaired") for n in (1, 13)])
    grid = evaluate_rows(rows[:, None, :], np.array([[100.0, 200.0, 300.0]]), "repaired")
    assert grid.thrust_N.shape == (2, 3)
    assert grid.thrust_N[1, 2] == evaluate(configuration(13), 300.0).thrust_N


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


def test_compiled_point_takes_less_than_20_microseconds() -> None:
    for law in LAWS:
        speeds = np.random.default_rng(5).uniform(0.0, 700.0, 20_000)
        evaluate(configuration(13), speeds[:2], law)
        start = time.perf_counter()
        evaluate(configuration(13), speeds, law)
        assert (time.perf_counter() - start) / len(speeds) < 20e-6

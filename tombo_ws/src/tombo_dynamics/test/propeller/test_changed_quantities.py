"""Changed materials, joint and air move the thrust as physics says."""

from dataclasses import replace

import numpy as np
import pytest

from tombo_dynamics.propeller import (
    LAWS,
    Surroundings,
    configuration,
    configurations,
    evaluate,
    parameter_row,
    read_library,
    speed_of_maximum_thrust,
)
from tombo_dynamics.propeller.laws.parameters import SCALARS
from tombo_dynamics.propeller.thrust_map import peak_of_rows

SPEEDS = np.array([100.0, 300.0, 450.0])


def with_nodus(**changes):
    return replace(configuration(13), nodus=replace(configuration(13).nodus, **changes))


def test_changes_of_nodus_air_and_materials_move_the_thrust() -> None:
    base, rigid = evaluate(13, SPEEDS).thrust_N, evaluate(0, SPEEDS).thrust_N
    thin = evaluate(13, SPEEDS, surroundings=Surroundings(air_density_kg_m3=1.0)).thrust_N
    assert (thin < base).all()
    stiff = evaluate(with_nodus(fibres=9), SPEEDS).thrust_N
    assert (np.abs(stiff - rigid) < np.abs(base - rigid)).all()
    matrix = read_library().matrices["DragonSkin10"]
    soft = evaluate(with_nodus(matrix=matrix), SPEEDS).thrust_N
    assert (np.abs(soft - rigid) > np.abs(base - rigid)).all()


@pytest.mark.parametrize("law", LAWS)
def test_peak_of_all_is_the_peak_of_each(law: str) -> None:
    rows = np.stack([parameter_row(c, law) for c in configurations()])
    speed, has_maximum, further = peak_of_rows(rows, law)
    for chosen in configurations():
        top, exists = speed_of_maximum_thrust(chosen, law)
        assert has_maximum[chosen.number] == exists
        assert speed[chosen.number] == pytest.approx(top, rel=1e-9)
    assert further.all()


def test_peak_that_the_law_does_not_reach() -> None:
    rows = np.tile(parameter_row(configuration(13), "repaired"), (2, 1))
    rows[:, SCALARS["twist_limit"]] = 0.1, 0.5
    _, has_maximum, further = peak_of_rows(rows, "repaired")
    assert has_maximum.tolist() == further.tolist() == [False, True]

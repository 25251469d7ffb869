"""The Pareto set: nobody in it is beaten, everybody outside of it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_propeller.design.design import nondominated

COSTS = st.lists(
    st.lists(st.sampled_from([0.0, 1.0, 2.0, 3.0]), min_size=3, max_size=3), max_size=30
)


def dominates(a: np.ndarray, b: np.ndarray) -> bool:
    return bool((a <= b).all() and (a < b).any())


@pytest.mark.slow
@given(COSTS)
def test_the_set_is_not_dominated_and_dominates_the_rest(rows):
    costs = np.array(rows, dtype=float).reshape(-1, 3)
    kept = nondominated(costs)
    for i, row in enumerate(costs):
        beaten = any(dominates(other, row) for other in costs)
        assert kept[i] == (not beaten)


def test_a_row_with_an_unknown_figure_is_out_and_beats_nobody():
    costs = np.array([[0.0, np.nan], [1.0, 1.0], [2.0, 2.0]])
    assert nondominated(costs).tolist() == [False, True, False]


def test_no_rows_give_no_nondominated_rows():
    assert nondominated(np.empty((0, 3))).shape == (0,)

"""The comparison with crazyflow: the course, our flights and the table."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from tombo_benchmarks.peers import (
    CORNERS,
    comparison,
    course_scenario,
    fly_course,
    fly_crazyflow,
    order,
    set_points,
)
from tombo_dynamics.errors import InputError


def test_the_course_is_smooth_and_ends_at_its_last_corner():
    rows = set_points()
    assert len(rows) == 600  # 12 s at 50 Hz
    np.testing.assert_allclose(rows[-1], [*CORNERS[-1], *[0.0] * 6], atol=1e-9)
    means = 0.5 * (rows[1:, 3:6] + rows[:-1, 3:6])
    np.testing.assert_allclose(np.diff(rows[:, :3], axis=0) / 0.02, means, atol=0.02)
    json.dumps(order(course_scenario()))


@pytest.mark.slow
def test_each_vehicle_of_a_batch_flies_what_one_flies():
    (rate, one), (_, many) = fly_course(1, 12000), fly_course(17, 12000)
    assert rate > 0.0
    np.testing.assert_allclose(one[0], CORNERS[-1], atol=0.02)
    np.testing.assert_array_equal(many[0], one[0])
    assert len(np.unique(many, axis=0)) == 17


def test_the_table_has_ratios_and_distances():
    theirs = {"rates": {"1": [1e6, 3e6, 2e6]}, "end": [0.0, 0.0, 1.004], "versions": "crazyflow 1"}
    table = comparison({"rates": {"1": [4e6, 5e6, 3e6]}, "end": CORNERS[-1]}, theirs)
    assert "| steps of 1 vehicles | 4 M | 2 M | 2 |" in table
    assert "| 0.0 mm | 4.0 mm |" in table


def test_a_python_without_crazyflow_is_refused():
    with pytest.raises(InputError, match="ModuleNotFoundError: No module named 'crazyflow'"):
        fly_crazyflow(Path(sys.executable), {})

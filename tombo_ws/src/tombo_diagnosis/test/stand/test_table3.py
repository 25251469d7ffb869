"""The paper's Table III: no extension is surely better than the mean, and what would settle it."""

import functools

import numpy as np
import pytest

from tombo_diagnosis.stand.table3 import statement, study_table3, table3_points

pytestmark = pytest.mark.slow


@functools.cache
def study():
    return study_table3()


def test_errors_of_law_and_mean_are_those_known():
    """RMS over the soft ones 0.055 N, their mean 0.038 N; rank correlation 0.09 (p = 0.81)."""
    assert study().rms["published"] == pytest.approx(0.055, abs=6e-4)
    assert study().rms["their mean"] == pytest.approx(0.038, abs=6e-4)
    assert study().spearman == pytest.approx(0.09, abs=0.01)
    assert study().spearman_p == pytest.approx(0.81, abs=0.01)


def test_the_mean_left_one_out_is_the_known_multiple_of_the_spread():
    """Leaving one of n out scales the deviation from the mean by n / (n - 1)."""
    mean = next(p for p in study().predictions if p.what == "mean of the others")
    assert mean.rmse == pytest.approx(study().rms["their mean"] * 9 / 8, rel=1e-9)


def test_no_extension_is_surely_better_and_it_says_so():
    assert all(p.high >= 0.0 for p in study().predictions)
    assert "no extension predicts" in statement(study())


def test_left_out_errors_are_never_better_than_fitting_all():
    """Stiffening fitted to all but the one predicted: its errors can't beat those of the fit."""
    stiff = next(p for p in study().predictions if p.what == "centrifugal_stiffening")
    assert stiff.rmse > 0.038


def test_softer_and_faster_settles_more_easily():
    noise = {s.what: s.sigma for s in study().settling}
    assert noise["thrust of Conf. 5 at 4500 rpm"] > noise["thrust of Conf. 5 at 3200 rpm"]
    assert noise["thrust of Conf. 5 at 3200 rpm"] > 5 * noise["thrust of Conf. 13 at 3200 rpm"]
    for s in study().settling:
        assert s.sigma == pytest.approx(s.difference / np.sqrt(8.0))


def test_the_points_are_the_paper_s():
    points = table3_points()
    assert points.count == 10
    assert points.readings[1, 0] == 0.656 and points.sigma[1, 0] == 0.03
    assert np.allclose(points.setup.speed, 2000.0 * np.pi / 30.0)

"""The plots of a diagnosis show what they should."""

import numpy as np
import pytest
from diagnosis_samples import DRAG, MASS, leftover, sample
from matplotlib.colors import to_hex

from tombo_diagnosis.report.figures import AFTER, BEFORE, draw_dependence, draw_pair
from tombo_diagnosis.report.residual_data import best_pair, by_channel

pytestmark = pytest.mark.slow


def slope_of(bars):
    """The slope of the means that error bars are drawn about."""
    return np.polyfit(*bars.lines[0].get_data(), 1)[0]


def test_the_residual_against_its_driver_has_the_slope_of_the_drag_before_and_none_after():
    axes = draw_pair(best_pair(by_channel(sample().residuals))).axes[0]
    assert axes.get_xlabel() == "body velocity y [m/s]"
    slopes = {to_hex(bars.lines[0].get_color()): slope_of(bars) for bars in axes.containers}
    assert slopes[BEFORE.lower()] == pytest.approx(-DRAG / MASS, rel=0.05)
    assert slopes[AFTER.lower()] == pytest.approx(0.0, abs=0.02)


def test_a_leftover_is_drawn_against_the_variable_that_it_follows():
    left = leftover()
    axes = draw_dependence(left, left.dependences[0]).axes[0]
    assert axes.get_xlabel() == "place x [m]"
    assert slope_of(axes.containers[0]) == pytest.approx(-0.5, abs=0.1), "a spring along x"

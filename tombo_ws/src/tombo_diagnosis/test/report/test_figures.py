"""The plots of a diagnosis: they are drawn for every verdict, and the poster fits a README."""

import math
import struct

import numpy as np
import pytest
from diagnosis_samples import leftover, sample
from matplotlib.colors import to_hex

from tombo_diagnosis.diagnosis import VERDICTS, Diagnosis
from tombo_diagnosis.report.figures import AFTER, BEFORE, draw_dependence, draw_summary
from tombo_flight.report.flight_plot import figure_bytes

pytestmark = pytest.mark.slow

EMPTY = Diagnosis("unknown", (), (), None, (), (), (), (), (), math.nan, "")


def lines(axes, colour):
    return [
        line for line in axes.lines if to_hex(line.get_color()) == to_hex(colour)
        and len(line.get_xdata()) > 100
    ]  # fmt: skip


def test_the_poster_shows_the_gap_and_that_it_closed():
    poster = draw_summary(sample())
    data = figure_bytes(poster)
    assert struct.unpack(">II", data[16:24]) == (1600, 900)
    assert len(data) < 300_000
    words = " ".join(text.get_text() for text in poster.texts)
    assert "The cause is linear rotor drag" in words
    assert "0.283 N s/m" in words
    gap = poster.axes[0]
    assert gap.get_xlabel() == "body velocity y [m/s]"
    before, after = lines(gap, BEFORE)[0], lines(gap, AFTER)[0]
    assert np.std(before.get_ydata()) > 3 * np.std(after.get_ydata())
    gains = poster.axes[-1]
    shown = [label.get_text() for label in gains.get_yticklabels()]
    assert shown == ["velocity x", "velocity y", "specific force x", "specific force y"]
    widths = [p.get_width() for p in gains.patches if to_hex(p.get_facecolor()) == AFTER.lower()]
    assert widths == pytest.approx([14.7, 15.4, 25.5, 25.7])


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_poster_is_drawn_for_every_verdict(verdict):
    result = sample(verdict, flights=2, seconds=10.0)
    assert figure_bytes(draw_summary(result)).startswith(b"\x89PNG")


def test_a_leftover_is_drawn_against_the_variable_that_it_follows():
    left = leftover()
    axes = draw_dependence(left, left.dependences[0]).axes[0]
    assert axes.get_xlabel() == "place x [m]"
    slopes = [np.polyfit(*bars.lines[0].get_data(), 1)[0] for bars in axes.containers]
    assert slopes[0] == pytest.approx(-0.5, abs=0.1), "a spring along x"

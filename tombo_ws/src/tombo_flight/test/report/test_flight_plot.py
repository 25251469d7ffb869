import io
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.image import imread
from matplotlib.text import Text

from tombo_flight.report.flight_plot import draw_flight
from tombo_flight.report.style import envelope, figure_bytes

EDGES = [
    "no contact",
    "crashed",
    "cut short at 0.3 s",
    "one sample",
    "cut short after contact",
    "detected before contact",
]


SIZE = (1800, 1200)


def assert_is_a_picture(image):
    assert image.var() > 0.002, "the picture is blank"
    dark = np.argwhere(image.mean(axis=2) < 0.6)
    reach = (dark.max(axis=0) - dark.min(axis=0)) / image.shape[:2]
    assert (reach > 0.6).all(), "the ink does not reach over the picture"


@pytest.mark.slow
def test_the_file_is_large_sharp_and_small_in_bytes(flight):
    png = figure_bytes(draw_flight(flight))
    assert imread(io.BytesIO(png), format="png").shape[:2] == SIZE[::-1]
    assert len(png) < 400_000


def drawn_texts(figure):
    """Every text that is on the picture, with its box in pixels."""
    figure.canvas.draw()
    hidden = set()
    for axis in [a for axes in figure.axes for a in (axes.xaxis, axes.yaxis)]:
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            off = not axis.axes.axison or not low <= tick.get_loc() <= high
            hidden |= {tick.label1, tick.label2} if off else set()
    texts = [t for t in figure.findobj(Text) if t.get_text().strip() and t.get_visible()]
    renderer = figure.canvas.get_renderer()
    return [(t.get_text(), t.get_window_extent(renderer)) for t in texts if t not in hidden]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["whole", *EDGES])
def test_every_flight_is_drawn_and_no_text_covers_another(flight, edge_flights, name):
    figure = draw_flight(flight if name == "whole" else edge_flights[name])
    boxes = drawn_texts(figure)
    assert_is_a_picture(np.asarray(figure.canvas.buffer_rgba())[:, :, :3] / 255.0)
    assert len(boxes) > 10
    width, height = figure.canvas.get_width_height()
    assert (width, height) == SIZE
    for words, box in boxes:
        assert box.x0 > -1 and box.y0 > -1, words
        assert box.x1 < width + 1 and box.y1 < height + 1, words
    for (a, one), (b, two) in itertools.combinations(boxes, 2):
        wide = min(one.x1, two.x1) - max(one.x0, two.x0)
        tall = min(one.y1, two.y1) - max(one.y0, two.y0)
        assert wide < 2.0 or tall < 2.0, f"{a!r} covers {b!r} by {wide:.0f} x {tall:.0f} px"


def upright_lines(axes):
    lines = [line.get_xdata() for line in axes.lines]
    return {round(float(x[0]), 3) for x in lines if len(x) == 2 and x[0] == x[1]}


def test_contact_and_phases_are_marked_where_they_were(flight):
    figure = draw_flight(flight)
    whole, zoomed = (
        next(a for a in figure.axes if a.get_ylabel() == "height z [m]" and a.get_xlim()[0] == x)
        for x in (0.0, -2.0)
    )
    contact_s, known_s, unstable_s, recovery_s = (
        flight.summary[f"{name}_s"]
        for name in ("collision_time", "contact_known", "unstable_phase", "recovery_time")
    )
    assert round(contact_s, 3) in upright_lines(whole)
    assert {0.0, round(known_s, 3)} <= upright_lines(zoomed)
    bands = sorted((p.get_x(), p.get_x() + p.get_width()) for p in zoomed.patches)
    assert np.allclose(bands, [(0.0, unstable_s), (unstable_s, recovery_s)])
    assert zoomed.get_xlim() == (-2.0, 6.0)
    words = [t.get_text() for t in zoomed.get_legend().get_texts()]
    assert {f"unstable {unstable_s:.2f} s", f"detection +{1e3 * known_s:.0f} ms"} <= set(words)


@given(values=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=400), buckets=st.integers(1, 40))
def test_a_thinned_line_keeps_its_ends_its_order_and_its_extremes(values, buckets):
    y = np.array(values)
    t = np.arange(len(y), dtype=float)
    thin_t, thin_y = envelope(t, y, buckets)
    assert len(thin_t) <= max(2 * buckets + 2, 2)
    assert (np.diff(thin_t) > 0).all()
    assert (thin_t[0], thin_t[-1]) == (t[0], t[-1])
    assert (thin_y.min(), thin_y.max()) == (y.min(), y.max())
    assert all(y[int(k)] == v for k, v in zip(thin_t, thin_y, strict=True))

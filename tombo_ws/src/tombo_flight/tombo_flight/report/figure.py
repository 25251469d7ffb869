"""A figure in the style of all figures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tombo_flight.report import style


@contextmanager
def new_figure(
    width_in: float, height_in: float, dpi: int, font_size: float = 8.5, **more: Any
) -> Iterator[Figure]:
    """Make a figure without a window, to be drawn within the context; `more` goes to it."""
    legend = style.RC["legend.fontsize"] / style.RC["font.size"] * font_size
    with mpl.rc_context({**style.RC, "font.size": font_size, "legend.fontsize": legend}):
        figure = Figure(figsize=(width_in, height_in), dpi=dpi, **more)
        FigureCanvasAgg(figure)
        yield figure

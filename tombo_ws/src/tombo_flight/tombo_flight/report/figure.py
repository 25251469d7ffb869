"""A figure in the style of all figures, and as the bytes of a picture."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_flight.report import style

if TYPE_CHECKING:  # it takes long to load
    from matplotlib.figure import Figure


@contextmanager
def new_figure(
    width_in: float, height_in: float, dpi: int, font_size: float = 8.5, **more: Any
) -> Iterator[Figure]:
    """Make a figure without a window, to be drawn within the context; `more` goes to it."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    legend = style.RC["legend.fontsize"] / style.RC["font.size"] * font_size
    with mpl.rc_context({**style.RC, "font.size": font_size, "legend.fontsize": legend}):
        figure = Figure(figsize=(width_in, height_in), dpi=dpi, **more)
        FigureCanvasAgg(figure)
        yield figure


def figure_bytes(figure: Figure) -> bytes:
    """Return a figure as a PNG file, the same bytes each time."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def envelope(t: Array, y: Array, buckets: int) -> tuple[Array, Array]:
    """Thin a line to about 2 * `buckets` points that keep the extremes of every bucket.

    `t` and `y` are (N,); the result has the same first and last sample and is in time order.
    """
    n = len(t)
    if n <= 2 * buckets:
        return t, y
    per = -(-n // buckets)
    padded = np.full(per * -(-n // per), y[-1])
    padded[:n] = y
    rows = padded.reshape(-1, per)
    offsets = np.arange(len(rows)) * per
    picks = np.stack((rows.argmin(axis=1) + offsets, rows.argmax(axis=1) + offsets))
    index = np.unique(np.clip(np.append(picks, (0, n - 1)), 0, n - 1))
    return t[index], y[index]

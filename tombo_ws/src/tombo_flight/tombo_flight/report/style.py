"""A figure in the style of all figures, and as the bytes of a picture.

The colours are Okabe and Ito's, which colour-blind readers can tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tombo_dynamics.arrays import Array

if TYPE_CHECKING:  # it takes long to load
    from matplotlib.figure import Figure

BLUE: Final = "#0072B2"
GREEN: Final = "#009E73"
ORANGE: Final = "#E69F00"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#AA4499"
SKY: Final = "#56B4E9"

INK: Final = "#1B2733"
MUTED: Final = "#66737F"
FAINT: Final = "#D9DFE4"
PAPER: Final = "#FFFFFF"

FRONT_LEFT: Final = VERMILLION
"""The rotor that meets the obstacle."""

ROTOR_COLOURS: Final = ("#4C6E91", "#8FA3B5", FRONT_LEFT, "#2B9E8F")
"""front_right, rear_left, front_left, rear_right."""

UNSTABLE: Final = "#F4B183"
RECOVERY: Final = "#9CC9E3"

LAW_COLOURS: Final = {"published": VERMILLION, "repaired": BLUE, "consistent": GREEN}
"""The laws of the propeller, in every picture."""

PHASE_COLOURS: Final = {
    0: "#C9D1D8",  # idle
    1: "#8FB8DE",  # takeoff
    2: "#B5D3EC",  # hover
    3: "#5B8DB8",  # approach
    4: "#E07B39",  # react
    5: "#6DBE9E",  # hold
    6: "#B7A6D3",  # land
    7: "#C9D1D8",  # landed
    8: "#C85C6B",  # descend_blind
}

PX4_COLOURS: Final = {
    "offboard": "#8FB8DE",
    "land": "#B7A6D3",
    "hold": "#6DBE9E",
    "return": "#E07B39",
}

RC: Final[dict[str, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "hatch.linewidth": 0.5,
    "mathtext.fontset": "dejavusans",
    "legend.frameon": False,
    "legend.fontsize": 7.8,
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
}
"""Matplotlib's settings for every figure; the fonts come with matplotlib."""


@contextmanager
def new_figure(
    width_in: float, height_in: float, dpi: int, font_size: float = 8.5, **more: Any
) -> Iterator[Figure]:
    """Make a figure without a window, to be drawn within the context; `more` goes to it."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    legend = RC["legend.fontsize"] / RC["font.size"] * font_size
    with mpl.rc_context({**RC, "font.size": font_size, "legend.fontsize": legend}):
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

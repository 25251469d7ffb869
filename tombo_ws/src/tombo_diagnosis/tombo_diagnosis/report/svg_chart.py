"""A chart as text of HTML: an SVG that stretches with the page, labels that keep their size.

Colours are classes of the page's style sheet, so that a chart is readable in light and in dark.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array

SIZE: Final = 2000
"""Width and height of the drawing in its own units; the page stretches it."""


@dataclass(frozen=True)
class Axis:
    """One axis: what it spans, and its words."""

    low: float
    high: float
    label: str = ""

    def at(self, values: Array) -> NDArray[np.int64]:
        """Return where values lie, from 0 to SIZE; what is far outside stays just outside."""
        share = (np.asarray(values, dtype=float) - self.low) / (self.high - self.low)
        return np.rint(SIZE * np.clip(share, -0.5, 1.5)).astype(np.int64)


@dataclass
class Chart:
    """Marks on two axes; `html` makes the text of it."""

    x: Axis
    y: Axis
    name: str
    """What it shows, for those who can't see it."""
    marks: list[str] = field(default_factory=list)

    def band(self, low: float, high: float) -> None:
        """Fill the whole width between two heights."""
        if math.isfinite(low) and math.isfinite(high):
            bottom, top = _up(self.y.at(np.array([low, high])))
            self.marks.append(_box(0, top, SIZE, bottom - top, "noise"))

    def span(self, start: float, end: float) -> None:
        """Fill the whole height between two places."""
        left, right = self.x.at(np.array([start, end]))
        if right > 0 and left < SIZE:
            self.marks.append(_box(int(left), 0, max(int(right - left), 4), SIZE, "apart"))

    def line(self, pieces: Sequence[tuple[Array, Array]], style: str) -> None:
        """Draw a line, in pieces where it has gaps."""
        self._path((self._walk(x, y) for x, y in pieces if len(x)), style)

    def dots(self, x: Array, y: Array, style: str) -> None:
        """Draw points, as lines of no length with round ends: they stay round."""
        across, up = self.x.at(x), _up(self.y.at(y))
        self._path((f"M{a} {b}h0" for a, b in zip(across, up, strict=True)), f"dots {style}")

    def bars(self, x: Array, mean: Array, half: Array, style: str) -> None:
        """Draw means with their intervals, joined by a line."""
        across, up = self.x.at(x), _up(self.y.at(mean))
        low = _up(self.y.at(mean - np.nan_to_num(half)))
        high = _up(self.y.at(mean + np.nan_to_num(half)))
        whiskers = (f"M{a} {b}V{c}" for a, b, c in zip(across, low, high, strict=True))
        self._path(whiskers, f"whisker {style}")
        self.line([(x, mean)], f"mean {style}")
        self._path((f"M{a} {b}h0" for a, b in zip(across, up, strict=True)), f"knots {style}")

    def html(self, style: str = "", *, ticks: bool = True) -> str:
        """Return the chart, its labels beside it; without `ticks` nothing but the picture."""
        kind = f"graph {style}".strip()
        picture = (
            f'<svg viewBox="0 0 {SIZE} {SIZE}" preserveAspectRatio="none" role="img" '
            f'aria-label="{escape(self.name)}">{self._grid()}{"".join(self.marks)}</svg>'
        )
        if not ticks:
            return f'<div class="{kind}"><div class="plot">{picture}</div></div>'
        return (
            f'<div class="{kind}"><div class="ylabel">{escape(self.y.label)}</div>'
            f'<div class="plot">{picture}{_labels(self.x, "xt", 6)}{_labels(self.y, "yt", 5)}'
            f'</div><div class="xlabel">{escape(self.x.label)}</div></div>'
        )

    def _grid(self) -> str:
        rows = _up(self.y.at(np.array(nice_ticks(self.y.low, self.y.high, 5)[0])))
        columns = self.x.at(np.array(nice_ticks(self.x.low, self.x.high, 6)[0]))
        path = "".join(f"M0 {r}H{SIZE}" for r in rows) + "".join(f"M{c} 0V{SIZE}" for c in columns)
        zero = _up(self.y.at(np.zeros(1)))[0]
        axis = f'<path class="zero" d="M0 {zero}H{SIZE}"/>' if 0 < zero < SIZE else ""
        return f'<path class="grid" d="{path}"/>{axis}'

    def _walk(self, x: Array, y: Array) -> str:
        across, up = self.x.at(x), _up(self.y.at(y))
        steps = "L".join(f"{a} {b}" for a, b in zip(across, up, strict=True))
        return f"M{steps}" if len(x) > 1 else f"M{steps}h0"

    def _path(self, parts: Iterable[str], style: str) -> None:
        data = "".join(parts)
        if data:
            self.marks.append(f'<path class="{style}" d="{data}"/>')


def nice_ticks(low: float, high: float, most: int) -> tuple[list[float], int]:
    """Return ticks at steps of 1, 2 or 5 times a power of ten, and the decimals they need."""
    span = high - low
    if not (math.isfinite(span) and span > 0.0):
        return [], 0
    power = 10.0 ** math.floor(math.log10(span / most))
    step = next(k * power for k in (1, 2, 5, 10) if k * power * most >= span * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return [k * step for k in range(first, last + 1)], digits


def _labels(axis: Axis, kind: str, most: int) -> str:
    ticks, digits = nice_ticks(axis.low, axis.high, most)
    side = "left" if kind == "xt" else "bottom"
    parts = []
    for tick in ticks:
        place = 100.0 * (tick - axis.low) / (axis.high - axis.low)
        text = f"{tick:.{digits}f}".replace("-", "−")
        parts.append(f'<span class="{kind}" style="{side}:{place:.1f}%">{text}</span>')
    return "".join(parts)


def _up(values: NDArray[np.int64]) -> NDArray[np.int64]:
    return SIZE - values


def _box(x: int, y: int, width: int, height: int, style: str) -> str:
    return f'<rect class="{style}" x="{x}" y="{y}" width="{width}" height="{height}"/>'

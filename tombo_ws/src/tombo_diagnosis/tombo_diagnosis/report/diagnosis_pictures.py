"""The pictures of the diagnosis report: the gap, what drives it, all channels; HTML text."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_diagnosis.diagnosis import Diagnosis, Residual
from tombo_diagnosis.report import diagnosis_plot_data as data
from tombo_diagnosis.report.diagnosis_plot_data import Pair, corrected, rms
from tombo_diagnosis.report.diagnosis_plots import pair_axes, small_axes, time_axes
from tombo_diagnosis.wording import capital, display_name, figure, percent, unit
from tombo_flight.report.figure import inline_svg, new_figure
from tombo_flight.report.html_page import hint

MOST_PANELS: Final = 60
"""Small pictures of the overview; of more flights those that show most."""
_POINTS: Final = 700
_SIZE_IN: Final = (4.8, 2.75)
_SMALL_IN: Final = (2.2, 0.8)


def main_plot(diagnosis: Diagnosis) -> str:
    """Return the first picture: one residual against its driver and against time."""
    shown = data.pairs(diagnosis, 1)
    groups = data.by_channel(diagnosis.residuals)
    if not groups:
        return hint("No residual to show: nothing could be compared.")
    channel = shown[0].channel if shown else next(iter(groups))
    residuals = groups[channel]
    drawn = [_driver_figure(pair) for pair in shown]
    drawn.append(_time_figure(diagnosis, residuals))
    extended = corrected(residuals)
    return f'{legend(extended)}<div class="figures">{"".join(drawn)}</div>{_told(residuals)}'


def legend(extended: bool, *, same: bool = False, apart: bool = False) -> str:
    """Return what the colours mean, once for all pictures of a panel."""
    faults = '<span><i class="apart"></i>fault or doubt in the log</span>' if apart else ""
    unchanged = '<span><i class="same"></i>the same before and after</span>' if same else ""
    after = '<span><i class="after"></i>after: extended model</span>' if extended else ""
    name = "before: model as it was" if extended else "measured minus model"
    return (
        f'<p class="legend"><span><i class="before"></i>{name}</span>{after}{unchanged}'
        f'<span><i class="noise"></i>±2σ of measurement noise</span>{faults}</p>'
    )


def drivers(diagnosis: Diagnosis) -> str:
    """Return the residuals against what drives them, beside the one in the first picture."""
    drawn = [_driver_figure(pair) for pair in data.pairs(diagnosis, 7)[1:]]
    if not drawn:
        return ""
    return f'{legend(corrected(diagnosis.residuals))}<div class="figures">{"".join(drawn)}</div>'


def overview(diagnosis: Diagnosis) -> str:
    """Return every channel in every flight, small, on one scale for each channel."""
    groups = data.by_channel(diagnosis.residuals)
    if not groups:
        return ""
    each = max(1, MOST_PANELS // len(groups))
    panels = sum(min(each, len(group)) for group in groups.values())
    buckets = int(np.clip(6000 // panels, 60, 220))
    with new_figure(*_SMALL_IN, 100) as sheet:
        sheet.add_axes((0.005, 0.01, 0.99, 0.98))  # one for all: to make them takes longest
        rows = [_row(sheet, diagnosis, group, each, buckets) for group in groups.values()]
    extended = corrected(diagnosis.residuals)
    same = extended and not all(corrected([r]) for r in diagnosis.residuals)
    apart = any(data.spans(finding) for finding in diagnosis.prechecks)
    return f"{legend(extended, same=same, apart=apart)}{''.join(rows)}"


def _row(
    sheet: Figure, diagnosis: Diagnosis, group: Sequence[Residual], each: int, buckets: int
) -> str:
    shown = list(group)
    if len(shown) > each:
        kept = sorted(shown, key=lambda r: -rms(r.before))[:each]
        shown = [r for r in group if any(r is k for k in kept)]
    sigma = max([0.0, *(r.sigma for r in group if math.isfinite(r.sigma))])
    limit = data.reach([r.before for r in group] + [r.after for r in group], 2.5 * sigma)
    cells = "".join(_small(sheet, diagnosis, r, limit, buckets) for r in shown)
    hidden = len(group) - len(shown)
    more = f" · {hidden} more flights not shown, smaller" if hidden else ""
    one = group[0]
    scale = f"±{figure(limit, 2)} {unit(one.unit)}"
    return (
        f'<div class="channel"><h3>{escape(display_name(one.channel))} '
        f"<small>{escape(_before_after(group))} · scale {escape(scale)}{more}</small></h3>"
        f'<div class="smalls">{cells}</div></div>'
    )


def _small(
    sheet: Figure, diagnosis: Diagnosis, residual: Residual, limit: float, buckets: int
) -> str:
    (axes,), (start, end) = sheet.axes, data.ends(residual.t)
    name = f"{display_name(residual.channel)} in {residual.flight} against time"
    for mark in (*axes.lines, *axes.patches):
        mark.remove()
    small_axes(axes, diagnosis, residual, limit, buckets)
    picture = inline_svg(sheet, name)
    return (
        f'<figure class="small">{picture}'
        f"<figcaption>{escape(residual.flight)} <span>{end - start:.0f} s</span></figcaption>"
        "</figure>"
    )


def _driver_figure(pair: Pair) -> str:
    name, driver = display_name(pair.channel), display_name(pair.driver)
    more = ", all flights; mean in slices with 95 % interval"
    return _figure(
        partial(pair_axes, pair=pair, dot=4.0, points=_POINTS), f"{name} against {driver}", more
    )


def _time_figure(diagnosis: Diagnosis, group: Sequence[Residual]) -> str:
    shown = data.clearest(group)
    draw = partial(time_axes, diagnosis=diagnosis, group=group)
    return _figure(draw, f"{display_name(shown.channel)} against time", f", flight {shown.flight}")


def _figure(draw: Callable[[Axes], None], name: str, more: str) -> str:
    with new_figure(*_SIZE_IN, 100, 8.5, layout="constrained") as sheet:
        draw(sheet.add_subplot())
        picture = inline_svg(sheet, name)
    caption = f"<b>{escape(name)}</b>{escape(more)}"
    return f"<figure>{picture}<figcaption>{caption}</figcaption></figure>"


def _told(residuals: Sequence[Residual]) -> str:
    """Return the RMS of a channel over all its flights beside that of noise, as a sentence."""
    text, noise = _before_after(residuals), data.noise_of(residuals)
    if math.isfinite(noise):
        text = f"{text}; noise alone makes {figure(noise)}"
    text = f"{capital(display_name(residuals[0].channel))}: {text}, all flights together."
    return f'<p class="told">{escape(text)}</p>'


def _before_after(residuals: Sequence[Residual]) -> str:
    """Return the RMS of a channel over all its flights in words."""
    before = rms(np.concatenate([r.before for r in residuals]))
    after = rms(np.concatenate([r.after for r in residuals]))
    where = unit(residuals[0].unit)
    if not corrected(residuals):
        return f"RMS {figure(before)} {where}"
    share = percent(1.0 - after / before) if before else "–"
    return f"RMS {figure(before)} → {figure(after)} {where} ({share} less)"

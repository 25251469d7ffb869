"""The plots of the diagnosis report: residual before and after, drivers, all channels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from typing import Final

import numpy as np

from tombo_diagnosis.diagnosis import Diagnosis, Residual
from tombo_diagnosis.report import diagnosis_plot_data as data
from tombo_diagnosis.report.diagnosis_plot_data import Pair, corrected, rms
from tombo_diagnosis.report.svg_chart import Axis, Chart
from tombo_diagnosis.wording import capital, display_name, figure, percent, unit
from tombo_dynamics.arrays import Array
from tombo_flight.report.html_page import hint
from tombo_logs.flight_log import Finding

MOST_PANELS: Final = 60
"""Small pictures of the overview; of more flights those that show most."""
_POINTS: Final = 700


def main_plot(diagnosis: Diagnosis) -> str:
    """Return the first picture: one residual against its driver and against time."""
    shown = data.pairs(diagnosis, 1)
    groups = data.by_channel(diagnosis.residuals)
    if not groups:
        return hint("No residual to show: nothing could be compared.")
    channel = shown[0].channel if shown else next(iter(groups))
    residuals = groups[channel]
    drawn = [_driver_figure(pair) for pair in shown]
    drawn.append(_time_figure(diagnosis, data.clearest(residuals)))
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
    rows = [_row(diagnosis, group, each, buckets) for group in groups.values()]
    extended = corrected(diagnosis.residuals)
    same = extended and not all(corrected([r]) for r in diagnosis.residuals)
    apart = any(_spans(finding) for finding in diagnosis.prechecks)
    return f"{legend(extended, same=same, apart=apart)}{''.join(rows)}"


def _row(diagnosis: Diagnosis, group: Sequence[Residual], each: int, buckets: int) -> str:
    shown = list(group)
    if len(shown) > each:
        kept = sorted(shown, key=lambda r: -rms(r.before))[:each]
        shown = [r for r in group if any(r is k for k in kept)]
    sigma = max([0.0, *(r.sigma for r in group if math.isfinite(r.sigma))])
    limit = data.reach([r.before for r in group] + [r.after for r in group], 2.5 * sigma)
    cells = "".join(_small(diagnosis, r, limit, buckets) for r in shown)
    hidden = len(group) - len(shown)
    more = f" · {hidden} more flights not shown, smaller" if hidden else ""
    one = group[0]
    scale = f"±{figure(limit, 2)} {unit(one.unit)}"
    return (
        f'<div class="channel"><h3>{escape(display_name(one.channel))} '
        f"<small>{escape(_before_after(group))} · scale {escape(scale)}{more}</small></h3>"
        f'<div class="smalls">{cells}</div></div>'
    )


def _small(diagnosis: Diagnosis, residual: Residual, limit: float, buckets: int) -> str:
    start, end = _ends(residual.t)
    name = f"{display_name(residual.channel)} in {residual.flight} against time"
    chart = Chart(Axis(start, end), Axis(-limit, limit), name)
    _time_marks(chart, diagnosis, residual, buckets)
    return (
        f'<figure class="small">{chart.html("tiny", ticks=False)}'
        f"<figcaption>{escape(residual.flight)} <span>{end - start:.0f} s</span></figcaption>"
        "</figure>"
    )


def _time_figure(diagnosis: Diagnosis, residual: Residual) -> str:
    start, end = data.stretch(residual)
    zero = data.zero_s(diagnosis, residual.flight)
    inside = (residual.t >= start) & (residual.t <= end)
    t, before, after = residual.t[inside], residual.before[inside], residual.after[inside]
    cut = replace(residual, t=t - zero, before=before, after=after)
    limit = data.reach([before, after], 2.5 * residual.sigma)
    name = display_name(residual.channel)
    from_zero = f" after {zero:.0f} s" if zero else ""
    chart = Chart(
        Axis(*_ends(cut.t), f"time [s]{from_zero}"),
        Axis(-limit, limit, f"{name} [{unit(residual.unit) or '1'}]"),
        f"{name} in {residual.flight} against time",
    )
    _time_marks(chart, diagnosis, cut, 420, zero)
    caption = f"<b>{escape(name)} against time</b>, flight {escape(residual.flight)}"
    return f"<figure>{chart.html()}<figcaption>{caption}</figcaption></figure>"


def _time_marks(
    chart: Chart, diagnosis: Diagnosis, residual: Residual, buckets: int, zero: float = 0.0
) -> None:
    for finding in diagnosis.prechecks:
        if finding.flight == residual.flight and _spans(finding):
            chart.span(finding.start_s - zero, finding.end_s - zero)
    chart.band(-2.0 * residual.sigma, 2.0 * residual.sigma)
    here = corrected([residual])
    same = not here and corrected(diagnosis.residuals)
    chart.line(data.runs(residual.t, residual.before, buckets), "same" if same else "before")
    if here:
        chart.line(data.runs(residual.t, residual.after, buckets), "after")


def _spans(finding: Finding) -> bool:
    """Return whether a finding is a fault of a stretch of a flight, or a doubt about it."""
    ends = math.isfinite(finding.start_s) and math.isfinite(finding.end_s)
    return ends and finding.severity != "info"


def _driver_figure(pair: Pair) -> str:
    name = display_name(pair.channel)
    chart = Chart(
        Axis(*pair.span, display_name(pair.driver)),
        Axis(-pair.limit, pair.limit, f"{name} [{unit(pair.unit) or '1'}]"),
        f"{name} against {display_name(pair.driver)}",
    )
    chart.band(-2.0 * pair.sigma, 2.0 * pair.sigma)
    for style, y in pair.series:
        chart.dots(*data.thinned(pair.x, y, _POINTS), style)
    for style, y in pair.series:
        bins = data.binned(pair.x, y, pair.block)
        chart.bars(bins.x, bins.mean, bins.half, style)
    caption = (
        f"<b>{escape(name)} against {escape(display_name(pair.driver))}</b>, all flights; mean in "
        "slices with 95 % interval"
    )
    return f"<figure>{chart.html()}<figcaption>{caption}</figcaption></figure>"


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


def _ends(t: Array) -> tuple[float, float]:
    finite = t[np.isfinite(t)]
    if not finite.size:
        return 0.0, 1.0
    start, end = float(finite.min()), float(finite.max())
    return (start, end) if end > start else (start - 0.5, start + 0.5)

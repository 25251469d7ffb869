"""The files of a comparison with healthy flights: JSON, a page, a plot."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tombo_diagnosis.change.diagnose import ChangeData
from tombo_diagnosis.change.features import Features
from tombo_diagnosis.change.summary_text import headline, phrase
from tombo_diagnosis.diagnosis import Change, Diagnosis
from tombo_diagnosis.report import diagnosis_sections
from tombo_diagnosis.report.diagnosis_output import JSON, REPORT, diagnosis_json
from tombo_diagnosis.report.diagnosis_text import CLASSES, badge
from tombo_diagnosis.wording import certainty, figure, interval, unit
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.report import style
from tombo_flight.report.flight_plot import figure_bytes
from tombo_flight.report.html_page import Page, page_html, pictures, sentences, table

if TYPE_CHECKING:
    from tombo_flight.process.output_folder import OutputFolder

PLOT: Final = "plots/changed.png"
CHANGE_FILES: Final = (JSON, REPORT, PLOT)
"""All names that a comparison may write."""


def change_labels(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return effect and rotor of each change, as in `set`."""
    return tuple(f"{c.effect}.{c.rotor}" if c.rotor else c.effect for c in diagnosis.changed)


def write_change(
    folder: OutputFolder,
    diagnosis: Diagnosis,
    data: ChangeData,
    *,
    pictures: bool = True,
    on_progress: ProgressCallback = no_progress,
) -> None:
    """Write the files of a comparison into an output folder, which the caller publishes.

    Raises:
        OSError: the files can't be written.
    """
    on_progress(f"writing {JSON}", 0.0)
    (folder / JSON).write_text(diagnosis_json(diagnosis), encoding="utf-8", newline="\n")
    if not pictures:
        return
    on_progress(f"writing {REPORT}", 0.3)
    png = figure_bytes(draw_change(data))
    (folder / "plots").mkdir()
    (folder / PLOT).write_bytes(png)
    (folder / REPORT).write_text(change_html(diagnosis, png), encoding="utf-8", newline="\n")


def change_html(diagnosis: Diagnosis, png: bytes) -> str:
    """Return the report as text; it loads nothing from anywhere."""
    title = headline(diagnosis.verdict, change_labels(diagnosis))
    text = "Each dot is a flight, each bar the mean. Demand: thrust that the healthy drive curve "
    text += "reads from the commands, against a quarter of the weight"
    logs = (("The logs", diagnosis_sections.prechecks(diagnosis.prechecks, "flight")),)
    faulty = any(f.severity == "fault" for f in diagnosis.prechecks)
    return page_html(
        Page(
            title=f"What has changed: {title}",
            eyebrow="Tombo diagnosis",
            verdict=badge(diagnosis),
            verdict_class=CLASSES[diagnosis.verdict],
            headline=title,
            summary=diagnosis.summary,
            cards=(),
            sections=(
                *(logs if faulty else ()),  # it may be all that has changed
                ("What has changed", pictures([(png, "Healthy and new flights", text)])),
                ("What it may be", _changes(diagnosis.changed)),
                ("What can’t be certified", sentences(diagnosis.notes)),
                ("All candidates", diagnosis_sections.candidates(diagnosis.candidates)),
                *(() if faulty else logs),
                ("Flights used", diagnosis_sections.flights(diagnosis)),
            ),
            footer=f"Held against: {diagnosis.model}. Intervals are 95 %. Diagnosed in "
            f"{figure(diagnosis.seconds, 2)} s after loading. The same in diagnosis.json.",
        )
    )


def _changes(changed: tuple[Change, ...]) -> str:
    rows = []
    for change in changed:
        label = f"{change.effect}.{change.rotor}" if change.rotor else change.effect
        for theta in change.theta:
            value, low, high = interval(theta)
            size = f"{theta.name.replace('_', ' ')} {value} {unit(theta.unit)} ({low} to {high})"
            rows.append((phrase(label), size, certainty(change.confidence)))
        if not change.theta:
            rows.append((phrase(label), "", certainty(change.confidence)))
    lines = [f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return table(("what", "how much", "probability"), lines) if lines else ""


def draw_change(data: ChangeData) -> Figure:
    """Draw demand a rotor, shake and swing of healthy and new flights."""
    canvas = Figure(figsize=(9.0, 3.4), layout="constrained")
    FigureCanvasAgg(canvas)
    left, right = canvas.subplots(1, 2, width_ratios=(4, 3))
    level = np.mean([f.demand for f in data.healthy], axis=0)
    names = [name.replace("_", "\n") for name in ROTOR_NAMES]
    _bars(left, names, data, lambda f: 100.0 * np.expm1(f.demand - level))
    left.set_ylabel("demand against healthy [%]")
    base = np.mean([[*f.shake, f.swing] for f in data.healthy], axis=0)
    names = ["commands\n> 10 Hz", "acceleration\n> 10 Hz", "swing\n0.35 to 1.6 Hz"]
    _bars(right, names, data, lambda f: np.exp(np.array([*f.shake, f.swing]) - base))
    right.set_ylabel("against healthy [1]")
    left.legend(loc="best", frameon=False)
    return canvas


def _bars(axes: Axes, names: list[str], data: ChangeData, value: object) -> None:
    assert callable(value)
    sides: tuple[tuple[str, tuple[Features, ...], str, float], ...] = (
        ("healthy", data.healthy, style.BLUE, -0.2),
        ("new", data.new, style.VERMILLION, 0.2),
    )
    at = np.arange(len(names))
    for name, flights, colour, offset in sides:
        rows = np.array([value(f) for f in flights])
        axes.bar(at + offset, rows.mean(axis=0), 0.36, color=colour, alpha=0.45, label=name)
        for row in rows:
            axes.plot(at + offset, row, "o", color=colour, markersize=3.5)
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    axes.set_xticks(at, names)

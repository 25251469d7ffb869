"""The HTML page of a risk, in words: for who decides whether to fly."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tombo_flight.flight import fly_scenario
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.flight_plot import draw_flight, figure_bytes
from tombo_flight.report.html_page import (
    Card,
    Page,
    command,
    page_html,
    pictures,
    sentences,
    table,
)
from tombo_flight.risk.estimate import Sample
from tombo_flight.risk.inputs import settings_at
from tombo_flight.risk.study import RiskStudy
from tombo_flight.risk.words import (
    Result,
    answer_words,
    assumption_words,
    decision_words,
    one_in,
    percent,
)

_MOST_PANELS = 3
_MOST_POINTS = 5000


def write_page(path: Path, study: RiskStudy, result: Result, sample: Sample) -> None:
    """Write the page; the most likely crash is flown again for its picture."""
    found = result["probability"]
    shown = result["high"] if found is None else found
    cards = [
        Card(
            "crash probability",
            ("below " if found is None else "") + percent(shown).removesuffix(" %"), "%",
            one_in(shown),
        ),
        Card(
            "95 % interval", f"{percent(result['low'])} to {percent(result['high'])}",
        ),
        Card(
            "flights", str(result["flights"]), "",
            f"{result['flights_of_estimate']} for the estimate, {result['method']}",
        ),
    ]  # fmt: skip
    page = Page(
        title=f"Risk of {study.label}",
        eyebrow="Risk of a crash",
        headline=study.label,
        summary=answer_words(result),
        cards=cards,
        sections=[
            ("What it assumes", sentences(assumption_words(result))),
            ("What decides", _decides(study, result, sample)),
            ("The most likely way to crash", _most_likely(study, result, sample)),
        ],
        footer=f"tombo {study.tombo_version}; all flights: flights.parquet; figures: risk.json",
    )
    path.write_text(page_html(page), encoding="utf-8", newline="\n")


def _decides(study: RiskStudy, result: Result, sample: Sample) -> str:
    text = sentences(decision_words(result))
    indices = (result["influence"] or {}).get("indices") or ()
    rows = [
        f"<tr><td>{escape(row['key'])}</td><td>{row['first']:.2f}</td>"
        f"<td>{row['total']:.2f}</td></tr>"
        for row in indices
    ]
    if rows:
        text += table(("input", "first-order Sobol index", "total"), rows)
    if study.inputs:
        caption = "Margin of each flight over its inputs; below 0 it crashed"
        text += pictures([(figure_bytes(_draw(study, sample)), "", caption)])
    return text


def _draw(study: RiskStudy, sample: Sample) -> Figure:
    """Draw the margin over the first inputs."""
    shown = study.inputs[:_MOST_PANELS]
    every = -(-sample.margins.size // _MOST_POINTS)
    points, margins = sample.points[::every], sample.margins[::every]
    crashed = margins < 0.0
    texts = [settings_at(study.inputs, point) for point in points]
    with new_figure(4.0 * len(shown), 3.4, 110, layout="constrained") as figure:
        for i, axes in enumerate(figure.subplots(1, len(shown), squeeze=False)[0]):
            values = np.array([float(row[i].partition("=")[2]) for row in texts])
            for which, colour, name in (
                (~crashed, style.BLUE, "flown"), (crashed, style.VERMILLION, "crashed"),
            ):  # fmt: skip
                axes.plot(values[which], margins[which], ".", color=colour, ms=3.0, label=name)
            axes.axhline(0.0, color=style.MUTED, lw=0.8)
            axes.set(xlabel=shown[i].key, ylabel="margin")
        axes.legend()
    return figure


def _most_likely(study: RiskStudy, result: Result, sample: Sample) -> str:
    found: dict[str, Any] | None = result["most_likely_crash"]
    if found is None:
        return "<p>No crash was found.</p>"
    values = ", ".join(f"{key} = {value:.4g}" for key, value in found["inputs"].items())
    words = [
        f"Of all crashes found, its inputs are nearest to the usual ones: {values or 'as given'}; "
        f"{found['distance']:.1f} standard deviations away in all.",
        "This command flies it again, to the last bit:",
    ]
    scenario = study.scenario_at(settings_at(study.inputs, sample.points[found["flight"]]))
    record = fly_scenario(scenario, found["seed"])
    return (
        f"<p>{escape(words[0])}</p><p>{escape(words[1])}</p>{command(found['command'])}"
        + pictures([(figure_bytes(draw_flight(record)), "", "The flight, from its ground truth")])
    )

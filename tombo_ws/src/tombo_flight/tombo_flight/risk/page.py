"""What is said of a risk, in words: for who decides whether to fly."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tombo_flight.flight import fly_scenario
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.flight_plot import draw_flight
from tombo_flight.report.page import Card, Item, Page, Picture, Section, Table, Text
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


def risk_page(study: RiskStudy, result: Result, sample: Sample) -> Page:
    """Return the page of a risk.

    Args:
        study: what was flown.
        result: what came out.
        sample: the flights, for the pictures; for one, the most likely crash is flown again.
    """
    probability = result["probability"]
    bound = result["high"] if probability is None else probability
    cards = [
        Card(
            "crash probability",
            ("below " if probability is None else "") + percent(bound).removesuffix(" %"), "%",
            one_in(bound),
        ),
        Card("95 % interval", f"{percent(result['low'])} to {percent(result['high'])}"),
        Card(
            "flights", str(result["flights"]), "",
            f"{result['flights_of_estimate']} for the estimate, {result['method']}",
        ),
    ]  # fmt: skip
    return Page(
        title=f"Risk of {study.label}",
        eyebrow="Risk of a crash",
        headline=study.label,
        summary=answer_words(result),
        cards=cards,
        sections=[
            Section("What it assumes", [Text(assumption_words(result), "list")]),
            Section("What decides", _deciding_inputs(study, result, sample)),
            Section("The most likely way to crash", _most_likely_crash(study, result, sample)),
        ],
        data=result,
        footer=f"tombo {study.tombo_version}; all flights: flights.parquet; figures: risk.json",
    )


def _deciding_inputs(study: RiskStudy, result: Result, sample: Sample) -> list[Item]:
    items: list[Item] = [Text(decision_words(result), "list")]
    rows = [
        (row["key"], f"{row['first']:.2f}", f"{row['total']:.2f}")
        for row in (result["influence"] or {}).get("indices") or ()
    ]
    if rows:
        items.append(Table(("input", "first-order Sobol index", "total"), rows))
    if study.inputs:
        caption = "Margin of each flight over its inputs; below 0 it crashed"
        items.append(Picture(lambda: _draw_margins(study, sample), caption))
    return items


def _most_likely_crash(study: RiskStudy, result: Result, sample: Sample) -> list[Item]:
    crash = result["most_likely_crash"]
    if crash is None:
        return [Text(["No crash was found."])]
    values = ", ".join(f"{key} = {value:.4g}" for key, value in crash["inputs"].items())

    def draw() -> Figure:
        scenario = study.scenario_at(settings_at(study.inputs, sample.points[crash["flight"]]))
        return draw_flight(fly_scenario(scenario, crash["seed"]))

    words = (
        f"Of all crashes, its inputs are nearest to the usual ones: {values or 'as given'}; "
        f"{crash['distance']:.1f} standard deviations away in all."
    )
    return [
        Text([words, "This command flies it again, to the last bit:"]),
        Text([crash["command"]], "command"),
        Picture(draw, "The flight, from its ground truth"),
    ]


def _draw_margins(study: RiskStudy, sample: Sample) -> Figure:
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
                axes.plot(
                    values[which],
                    margins[which],
                    ".",
                    color=colour,
                    ms=3.0,
                    label=name,
                    rasterized=True,
                )
            axes.axhline(0.0, color=style.MUTED, lw=0.8)
            axes.set(xlabel=shown[i].key, ylabel="margin")
        axes.legend()
    return figure

"""What is said of a risk, in words: for who decides whether to fly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_flight.flight import fly_scenario
from tombo_flight.json_text import plain
from tombo_flight.process.study import Task
from tombo_flight.process.study_folder import Fly, StudyFolder
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.flight_plot import draw_flight
from tombo_flight.report.page import Card, Item, Page, Picture, Section, Table, Text
from tombo_flight.risk.estimate import METHODS, FlightSample, estimate
from tombo_flight.risk.result import check_of, influence, result_of
from tombo_flight.risk.study import RiskStudy, settings_at

Result = Mapping[str, Any]
_GOOD_FIT = 0.5


def answer_words(result: Result) -> str:
    """Return the answer in a sentence or two."""
    flights = f"{result['flights']} simulated flights of {result['scenario']}"
    if result["probability"] is None:
        return (
            f"No crash was found in {flights}. With 95 % confidence the probability of a crash "
            f"is below {percent(result['high'])} ({one_in(result['high'])})."
        )
    return (
        f"About {one_in(result['probability'])} crashes: probability "
        f"{percent(result['probability'])}, with 95 % confidence between "
        f"{percent(result['low'])} and {percent(result['high'])}, from {flights}."
    )


def decision_words(result: Result) -> list[str]:
    """Return what decides, in sentences."""
    lines = []
    for row in result["crashes"]:
        lines.append(
            f"Crashes lie at {row['key']} = {row['value']:.4g} on average, "
            f"{abs(row['deviations']):.1f} standard deviations "
            f"{'above' if row['deviations'] > 0.0 else 'below'} the median."
        )
    found = result["influence"]
    if found is None:
        return lines
    if found["indices"]:
        shares = ", ".join(f"{row['key']} {row['total']:.2f}" for row in found["indices"])
        lines.append(
            f"Of what the uncertain settings do to the margin, each has a share of (total Sobol "
            f"index): {shares}."
        )
    little = " The indices say little then; where the crashes lie says more."
    lines.append(
        f"A fitted polynomial of these settings predicts {100.0 * max(found['r2'], 0.0):.0f} % of "
        "the margin's variance in flights that it was not fitted to; the rest comes from sensor "
        "noise, gusts and scatter, or is too irregular for it."
        + little
        * (found["r2"] < _GOOD_FIT)
    )
    return lines


def assumption_words(result: Result) -> list[str]:
    """Return what the answer assumes, in sentences."""
    inputs = [
        f"{one['key']} ~ {one['distribution']} ({one['source']})" for one in result["inputs"]
    ]
    lines = [
        f"The settings vary independently as said: {'; '.join(inputs) or 'none varies'}.",
        "All else is as in the scenario; sensor noise, gusts and scatter are drawn anew in each "
        "flight.",
        "A crash is one of the simulation (docs/figures.md says what counts as one); what the "
        "model lacks is not in the figure.",
    ]
    given = result["drawn_as_given"]
    if result["method"] == "adaptive" and result["probability"] is not None:
        lines.append(
            "The interval holds if the search has met every way to crash. The "
            f"{given['flights']} flights that were drawn as given, {given['crashed']} of them "
            f"crashed, say without that assumption: below {percent(given['high'])}."
        )
    if result["not_flown"]["flights"]:
        lines.append(
            f"{result['not_flown']['flights']} flights could not be flown and count as crashes; "
            f"the first: {result['not_flown']['first']}"
        )
    return lines


def percent(share: float) -> str:
    """Return a probability in percent, with two digits."""
    return f"{100.0 * share:.2g} %"


def one_in(share: float) -> str:
    """Return a probability as "one flight in N"."""
    if share >= 0.5:
        return "every second flight or more"
    digits = 1 - int(math.log10(1.0 / share))
    return f"one flight in {round(1.0 / share, digits):.0f}"


_NOT_FLOWN = -1.0
"""Margin of a flight that can't be flown: it counts as a crash."""
_FEW_CRASHES = 10
"""With so many the interval of a count reaches from a half to twice of it."""
_MOST_PANELS = 3
_MOST_POINTS = 5000


def analyse_risk(study: RiskStudy, opened: StudyFolder, fly: Fly) -> Page:
    """Fly the stages of the estimate, add weights to the table, and return the page."""

    def margins(first: int, points: Array, seeds: NDArray[np.int64]) -> Array:
        tasks = (
            Task(first + i, tuple(settings_at(study.inputs, point)), int(seed))
            for i, (point, seed) in enumerate(zip(points, seeds, strict=True))
        )
        fly(tasks, len(seeds))
        flights, flown = opened.numbers("margin")
        flown = flown[np.searchsorted(flights, first) :][: len(seeds)]
        return np.where(np.isnan(flown), _NOT_FLOWN, flown)

    inputs, check = len(study.inputs), None
    answer, sample = estimate(inputs, study.flights, study.method, study.seed, margins)
    if study.check:
        plainly = METHODS[1], study.seed, margins, study.flights
        check = check_of(answer, *estimate(inputs, study.check, *plainly))
    opened.finish()
    opened.add_columns(_columns_of(sample, *opened.numbers("margin")))
    errors = [row["error"] for row in opened.rows(("error",)).values() if row["error"]]
    keys = [setting.key for setting in study.inputs]
    result = plain(result_of(study, answer, sample, errors, influence(keys, sample), check))
    return risk_page(study, result, sample)


def _columns_of(
    sample: FlightSample, flights: NDArray[np.int64], margins: Array
) -> dict[str, NDArray[Any]]:
    """Return what the table says of each flight besides its row.

    Args:
        sample: the flights of the estimate, which are the first ones; the others check it.
        flights: (N,) numbers of all.
        margins: (N,), NaN: not flown.
    """
    checks = np.arange(sample.margins.size, flights.size)
    return {
        "crashed": ~(margins >= 0.0),
        "weight": np.append(sample.weights, np.zeros(checks.size)),
        "drawn_as_given": np.append(sample.as_given, checks >= 0),
        "search": np.append(np.arange(sample.margins.size) < sample.first, checks < 0),
        "check": flights >= sample.margins.size,
    }


def risk_page(study: RiskStudy, result: Result, sample: FlightSample) -> Page:
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
    checked = []
    if (check := result["check"]) is not None:
        verdict = "agrees" if check["agrees"] else "differs"
        cards.append(Card("plain Monte Carlo", verdict, "", f"{check['flights']} more flights"))
        checked = [Section("Checked by plain Monte Carlo", _check_items(result))]
    return Page(
        title=f"Risk of {study.label}",
        eyebrow="Risk of a crash",
        headline=study.label,
        summary=answer_words(result),
        cards=cards,
        sections=[
            *checked,
            Section("What it assumes", [Text(assumption_words(result), "list")]),
            Section("What decides", _deciding_inputs(study, result, sample)),
            Section("The most likely way to crash", _most_likely_crash(study, result, sample)),
        ],
        data=result,
        footer=f"tombo {study.tombo_version}; all flights: flights.parquet; figures: risk.json",
    )


def check_words(result: Result) -> str:
    """Return whether the check agrees, in a sentence or two."""
    check = result["check"]
    words = (
        "The two agree: the 95 % interval of their difference has 0 in it."
        if check["agrees"]
        else "The two differ: the 95 % interval of their difference does not have 0 in it. The "
        "search may have missed a way to crash: believe the check, or fly more."
    )
    if check["crashes"] < _FEW_CRASHES:
        words += f" With fewer than {_FEW_CRASHES} crashes the check says little: fly more."
    return words


def _check_items(result: Result) -> list[Item]:
    check = result["check"]
    names = ("", "flights", "crashes", "probability", "95 % interval")
    estimated = (
        f"{result['method']}, {result['flights']} with the search",
        str(result["flights_of_estimate"]), str(result["crashes_of_estimate"]),
    )  # fmt: skip
    counted = ("drawn as given", str(check["flights"]), str(check["crashes"]))
    rows = [
        (*first, f"{each['probability'] or 0.0:.3g}", f"{each['low']:.2g} to {each['high']:.2g}")
        for first, each in ((estimated, result), (counted, check))
    ]
    ratio = check["ratio"]
    said = [] if ratio is None else [f"The estimate is {ratio:.2f} times the check's."]
    return [Table(names, rows), Text([*said, check_words(result)])]


def _deciding_inputs(study: RiskStudy, result: Result, sample: FlightSample) -> list[Item]:
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


def _most_likely_crash(study: RiskStudy, result: Result, sample: FlightSample) -> list[Item]:
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


def _draw_margins(study: RiskStudy, sample: FlightSample) -> Figure:
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

"""The page of a sweep: crash rates, what decides, tables, pictures, the worst flight in 3-D."""

from __future__ import annotations

from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tombo_dynamics.arrays import Array
from tombo_flight.flight import fly_scenario
from tombo_flight.report import style
from tombo_flight.report.figures import BY_KEY, Value, fixed
from tombo_flight.report.flight_report import replay_scripts
from tombo_flight.report.page import (
    Card,
    Cell,
    Item,
    Markup,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
    asset,
)
from tombo_flight.report.style import new_figure
from tombo_flight.sweep.folder import OUTCOME, SweepFolder
from tombo_flight.sweep.results import (
    HEAD,
    MEANING,
    Result,
    SweepFlights,
    crashed_text,
    point_rows,
    setting_words,
)
from tombo_flight.sweep.study import SweepStudy

_FEW_COLUMNS: Final = (0, 1, 3, 5)
"""Columns of the table of points that fit a terminal; of ranges the median."""
_DESIGNS: Final = {"full": "full factorial", "lhs": "Latin hypercube", "sobol": "Sobol sequence"}
_CSS: Final = """
header, main, footer { max-width: 1400px; }
.points { font-size: 0.78rem; width: 100%; }
.points thead th { vertical-align: bottom; padding: 0.22rem 0.7rem 0.22rem 0; }
.points td, .points tbody th { padding: 0.22rem 0.7rem 0.22rem 0; }
.points td:first-of-type, .points tbody th { white-space: nowrap; }
.points .group th { color: var(--muted); font-weight: 650; padding-top: 0.6rem; }
.stage .view .key { display: none; }
"""
_SHOWN: Final = (
    *("max_falling_distance_m", "unstable_phase_s", "recovery_time_s", "strikes"),
    *("contact_known_s", "settled_error_m", "max_tilt_rad", "hover_rms_m", "approach_rms_m"),
)
"""Figures of the table of all flights."""
_HISTOGRAMS: Final = (
    *("max_falling_distance_m", "unstable_phase_s", "recovery_time_s"),
    *("contact_known_s", "max_tilt_rad", "approach_rms_m"),
)


def sweep_page(opened: SweepFolder) -> Page:
    """Return the page of a sweep whose flights are all in its folder; the worst is flown again."""
    study, flights = opened.study, SweepFlights(opened)
    results = flights.results()
    total, worst = results["aggregate"], results["worst"]
    replayed = worst and fly_scenario(
        study.scenario_at(study.place(worst["flight"])[0]), worst["seed"]
    )
    draw = partial(draw_distributions, flights.flown, of_paper=results["of_paper"])
    return Page(
        title=f"Sweep of {study.label}",
        eyebrow="Sweep",
        headline=study.label,
        summary=_summary(study, results),
        verdict_style="bad" if 2 * total["crashed"] > total["flights"] else "good",
        cards=_cards(total),
        sections=[
            Section("All flights", _all_flights(results)),
            Section("Crash rate for each setting", _crash_rates(results)),
            Section("What decides", _decides(results)),
            Section("Points", _points(results, range(len(HEAD) + 1)), "page"),
            Section("Points", _points(results, _FEW_COLUMNS), "terminal"),
            Section("Distributions", [Picture(draw, "All flights; line: median")]),
            Section("Worst flight", _worst(results)),
        ],
        data=results,
        css=_CSS,
        scripts=replay_scripts(replayed) if replayed else "",
        footer=f"tombo {study.tombo_version}; all figures of all flights: flights.parquet",
    )


def _summary(study: SweepStudy, results: Result) -> str:
    total, first, end = results["aggregate"], *study.seeds
    if not study.keys:
        what = f"seeds {first} to {end - 1}"
    else:
        varied = ", ".join(study.keys)
        seeds = f"{end - first} seeds each"
        kind = _DESIGNS[study.design.kind]
        what = f"{kind}: {study.points} points over {varied}, {seeds}"
    counts = ", ".join(f"{total[name]} {name}" for name in ("collided", "detected", "landed"))
    alarms = f"{total['false_alarms']} false alarms"
    return f"{what}; {results['flights']} flights: {results[OUTCOME]}, {counts}; {alarms}."


def _cards(total: Result) -> list[Card]:
    rate = total["crash_rate"]
    cards = [
        Card("flights", f"{total['flights']}"),
        Card("crashed", "–" if rate is None else f"{100.0 * rate:.1f}", "%", crashed_text(total)),
        Card("recovered", f"{total['recovered']}", "", f"of {total['collided']} that collided"),
    ]
    for key, name, unit in (
        ("recovery_time_s", "recovery time", "s"),
        ("max_falling_distance_m", "falling distance", "m"),
    ):
        values = total[key]
        if values["count"]:
            note = f"5 to 95 %: {values['p05']:.2f} to {values['p95']:.2f}"
            cards.append(Card(name, f"{values['median']:.2f}", unit, note))
    return cards


def _all_flights(results: Result) -> list[Item]:
    of_paper, rows = results["of_paper"], []
    for key in _SHOWN:
        values, figure = results["aggregate"][key], BY_KEY[key]
        if values["count"]:  # without an obstacle, figures of collisions are missing
            printed = ["–" if figure.paper is None else f"{figure.paper:g}"] if of_paper else []
            parts = (values[part] for part in ("median", "p05", "p95", "max"))
            cells = [fixed(figure.factor * value, figure.digits) for value in parts]
            rows.append([figure.label, *printed, *cells, str(values["count"])])
    head = ["", *(["paper"] if of_paper else []), "median", "5 %", "95 %", "max", "of"]
    not_flown = results["not_flown"]
    items: list[Item] = [Table(head, rows)] if rows else []
    if not_flown["flights"]:
        first = f"flight {not_flown['first']}: {not_flown['why']}"
        items.append(Text([f"{not_flown['flights']} not flown; the first: {first}"]))
    return items


def _crash_rates(results: Result) -> list[Item]:
    rows: list[TableRow] = []
    for key, group in groupby(results["settings"], key=itemgetter("key")):
        rows.append(TableRow([key], "group"))
        for row in group:
            rate, style = row["crash_rate"], "bad" if row["crashed"] else ""
            rows.append(TableRow([row["value"], Cell(crashed_text(row), style, bar=rate or 0.0)]))
    note = "All flights with this setting, whatever else was varied; exact 95 % interval."
    return [Table(("setting", "crashed"), rows, note=note)] if rows else []


def _decides(results: Result) -> list[Item]:
    rows = [
        (row["key"], row["figure"], f"{row['rho']:+.2f}", f"{row['p']:.2g}", str(row["flights"]))
        for row in results["decides"]
    ]
    note = (
        "Spearman's rank correlation of a setting with a figure, over all flights: +1 where the "
        "figure always grows with the setting, 0 where neither grows with the other. p: "
        "probability of one as strong where there is none."
    )
    head = ("setting", "figure", "rank correlation", "p", "flights")
    return [Table(head, rows, note=note)] if rows else []


def _points(results: Result, columns: range | tuple[int, ...]) -> list[Item]:
    """Return the table of points with some columns of `point_rows`."""
    if len(results["points"]) < 2:
        return []
    short = len(columns) == len(_FEW_COLUMNS)
    rows: list[TableRow] = []
    head, compared = ("", *HEAD), False
    for group, lines in point_rows(results):
        if group:
            rows.append(TableRow([group], "group"))
            compared = True
        for line in lines:
            cells = [Cell(line[n].split(" (")[0] if short else line[n]) for n in columns]
            cells[1] = Cell(line[1], "" if line[1].startswith(("0 ", "–")) else "bad")
            rows.append(TableRow(cells))
    names = ["reaction" if compared else "setting", *head[1:]]
    return [Table([names[n] for n in columns], rows, "points", note=MEANING)]


def _worst(results: Result) -> list[Item]:
    worst: dict[str, Any] | None = results["worst"]
    if worst is None:
        return []
    how = "crashed" if worst["crashed"] else "did not crash"
    words = (
        f"{setting_words(worst['varied'])}, seed {worst['seed']}: it {how}, and of these it fell "
        "farthest. This command flies it again, to the last bit:"
    )
    return [Text([words]), Text([worst["command"]], "command"), Markup(asset("stage.html"))]


def draw_distributions(flights: pd.DataFrame, *, of_paper: bool) -> Figure:
    """Draw histograms; marked are median, 5 to 95 % of the flights, and the paper's value."""
    # Fixed places: a layout that measures the texts would draw all of them twice.
    places = {"left": 0.045, "right": 0.99, "bottom": 0.065, "top": 0.95, "hspace": 0.26}
    with new_figure(12.0, 7.0, 110) as figure:
        panels = figure.subplots(2, 3, gridspec_kw={**places, "wspace": 0.15}).flat
        for axes, key in zip(panels, _HISTOGRAMS, strict=True):
            figure_of = BY_KEY[key]
            values = figure_of.factor * flights[key].dropna().to_numpy(float)
            printed = figure_of.paper if of_paper else None
            _histogram(axes, values, figure_of.label, printed)
    return figure


def _histogram(axes: Axes, values: Array, label: str, printed: Value) -> None:
    axes.set_xlabel(label)
    axes.set_ylabel("flights")
    if not values.size:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", color=style.MUTED)
        axes.set(xticks=[], yticks=[])
        return
    bins = max(5, min(30, round(2.0 * values.size**0.5)))
    low, median, high = np.percentile(values, (5.0, 50.0, 95.0))
    axes.axvspan(low, high, color=style.FAINT, lw=0.0, label=f"5 to 95 %: {low:.3g} to {high:.3g}")
    counts, edges = np.histogram(values, bins)
    axes.stairs(counts, edges, fill=True, color=style.SKY)
    axes.axvline(median, color=style.INK, lw=1.4, label=f"median {median:.3g}")
    if isinstance(printed, float):
        axes.axvline(printed, color=style.VERMILLION, lw=1.8, ls="--", label=f"paper {printed:g}")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(0.0, 1.05 * counts.max())
    spacing = {"handlelength": 1.2, "handletextpad": 0.4, "columnspacing": 1.0}
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1, ncols=3, **spacing)

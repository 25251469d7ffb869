"""The page of an arena, with its pictures: histograms, crash rates, configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FormatStrFormatter, MaxNLocator, NullLocator

from tombo_bag.flight import Flight
from tombo_collision.reactions.none import NoReaction
from tombo_dynamics.arrays import Array
from tombo_flight.arena.results import HEAD, MEANING, arena_results, crashed_text, table_rows
from tombo_flight.arena.study import (
    ANGLE_RADIUS,
    COLLISIONS,
    CONFIGURATIONS,
    FREE,
    ROW_KEYS,
    SPEED_OFFSET,
    ArenaStudy,
)
from tombo_flight.flight import fly_scenario
from tombo_flight.json_text import plain
from tombo_flight.process.study import FlightRow
from tombo_flight.process.study_folder import Fly, StudyFolder
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.flight_report import replay_scripts
from tombo_flight.report.html import asset
from tombo_flight.report.page import (
    Card,
    Cell,
    Folded,
    Item,
    Markup,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
)

_CSS: Final = """
header, main, footer { max-width: 1400px; }
.arena { font-size: 0.78rem; width: 100%; }
.arena thead th { vertical-align: bottom; padding: 0.22rem 0.7rem 0.22rem 0; }
.arena td, .arena tbody th { padding: 0.22rem 0.7rem 0.22rem 0; }
.arena td:first-of-type, .arena tbody th { white-space: nowrap; }
.arena .group th { color: var(--muted); font-weight: 650; padding-top: 0.6rem; }
.arena .bad { color: var(--bad); font-weight: 600; }
.replays td { vertical-align: middle; } .replays code { font-size: 0.82em; user-select: all; }
.stage .view .key { display: none; }
"""
_SHORT: Final = (0, 1, 3, 5)
"""Columns for which a terminal has room, of ranges the median: the page has all."""
_FEW: Final = len(_SHORT)
_FOOTER: Final = (
    "Ground truth of simulated flights. Cells of the maps fly a third of the seeds. The same "
    "figures in arena.json, each flight in flights.parquet; the maps' exact numbers stand there "
    "too."
)
_MAPS: Final = (
    (
        "Speed and lateral offset",
        *(SPEED_OFFSET, "approach speed [m/s]", "y of the pillar's axis [m]"),
        "Crash rate over approach speed and lateral place of the pillar, in percent; the paper's "
        "pillar stands at y = 0.27 m and is flown at 0.7 m/s. At y = 0 both front discs touch",
    ),
    (
        "Angle of approach and radius",
        *(ANGLE_RADIUS, "angle from the nose to the course [°]", "radius of the obstacle [m]"),
        "Crash rate over angle of approach and radius, in percent. The disc that is foremost "
        "touches, at the paper's point and in the paper's direction off the course",
    ),
)


def analyse_arena(study: ArenaStudy, opened: StudyFolder, fly: Fly) -> Page:
    """Fly what is missing of the matches and return their page."""
    fly(study.tasks, len(study.tasks))
    opened.finish()
    kept = opened.rows((*ROW_KEYS, "error"))
    return arena_page(plain(arena_results(study, kept)), study, kept)


def arena_page(
    results: Mapping[str, Any], study: ArenaStudy, kept: Mapping[str, FlightRow]
) -> Page:
    """Return the page of an arena.

    Args:
        results: of `arena_results`.
        study: what was flown; the flights of the replay are flown again.
        kept: the rows of its flights.

    Raises:
        InputError: as `fly_scenario`.
    """
    shown = results["shown"]
    records = [_again(study, flight) for flight in shown]
    columns = range(len(HEAD))
    return Page(
        title=f"Tombo arena: {', '.join(results['reactions'])}",
        eyebrow="Tombo arena",
        headline=headline(results),
        summary=_summary(results),
        cards=[_card(name, results["collisions"][name]) for name in results["reactions"]],
        sections=[
            Section("Figures", _figures(results, (COLLISIONS, FREE), columns), "page"),
            Section("Figures", _figures(results, (COLLISIONS, FREE), _SHORT), "terminal"),
            Section("Fall and recovery", _histograms(results, study, kept)),
            *(Section(title, _map(results, *of)) for title, *of in _MAPS),
            Section("Configurations 1 to 13", _configurations(results), "page"),
            Section("Typical and worst flight of each reaction", _replays(shown), "page"),
            Section("Not flown", _refused(results["refused"])),
        ],
        data=results,
        footer=_FOOTER,
        css=_CSS,
        scripts=replay_scripts(records) if records else "",
    )


def headline(results: Mapping[str, Any]) -> str:
    """Return how many flights of the collisions each reaction lost, the fewest first."""
    pooled = results["collisions"]
    if not any(of["flights"] for of in pooled.values()):
        return "No flights of the collisions"
    order = sorted(pooled, key=lambda name: pooled[name]["crash_rate"])
    parts = [f"{name} {pooled[name]['crashed']}" for name in order]
    return f"Crashes in {pooled[order[0]]['flights']} collisions: {', '.join(parts)}"


def _summary(results: Mapping[str, Any]) -> str:
    flights = sum(of["flights"] for of in results["all_cases"].values())
    with_ = "with disturbances" if results["disturbances"] else "clean, without disturbances"
    return (
        f"{flights} flights, {with_}, seeds {results['first_seed']} to {results['last_seed']}; "
        "every reaction flies the same cases with the same seeds."
    )


def _card(name: str, pooled: Mapping[str, Any]) -> Card:
    rate, fall = pooled["crash_rate"], pooled["max_falling_distance_m"]["median"]
    beside = "" if fall is None else f"; falls {fall:.2f} m (median)"
    return Card(
        name,
        "–" if rate is None else f"{100.0 * rate:.1f}",
        "" if rate is None else "% crashed",
        crashed_text(pooled) + beside,
        tooltip="over all flights of the table's collisions",
    )


def _figures(
    results: Mapping[str, Any], groups: Sequence[str], columns: Sequence[int]
) -> list[Item]:
    """Return the table of some groups of cases with some columns of `HEAD`."""
    lines = []
    for case, rows in table_rows(results, groups):
        lines.append(TableRow([case], "group"))
        for row in rows:
            cells = [Cell(row[n] if len(columns) > _FEW else _middle(row[n])) for n in columns]
            cells[1] = Cell(row[1], "" if row[1].startswith("0 ") else "bad")
            lines.append(TableRow(cells))
    if not lines:
        return []
    return [Table([HEAD[n] for n in columns], lines, "arena", note=MEANING)]


def _middle(text: str) -> str:
    """Return the median of a cell without its range."""
    return text.split(" (")[0]


def _histograms(
    results: Mapping[str, Any], study: ArenaStudy, kept: Mapping[str, FlightRow]
) -> list[Picture]:
    flights: dict[str, list[FlightRow]] = {name: [] for name in results["reactions"]}
    for match, rows in study.rows(kept).items():
        if match.case.group == COLLISIONS:
            flights[match.reaction] += rows
    if not any(flights.values()):
        return []
    caption = "All flights of the collisions in the table; the line is the median, crashed in red"
    return [Picture(partial(draw_histograms, flights), caption)]


def _has(results: Mapping[str, Any], group: str) -> bool:
    return any(result["group"] == group for result in results["results"])


def _map(results: Mapping[str, Any], group: str, x: str, y: str, caption: str) -> list[Picture]:
    if not _has(results, group):
        return []
    return [Picture(partial(draw_map, results, group, x, y), caption)]


def _configurations(results: Mapping[str, Any]) -> list[Item]:
    if not _has(results, CONFIGURATIONS):
        return []
    caption = "The paper's collision with each configuration of its Table I"
    figures = _figures(results, (CONFIGURATIONS,), range(len(HEAD)))
    return [Picture(partial(draw_configurations, results), caption), Folded("In figures", figures)]


def _refused(reasons: Mapping[str, str]) -> list[Text]:
    lines = [f"{case}: {reason}" for case, reason in reasons.items()]
    return [Text(lines, "list")] if lines else []


def _replays(shown: Sequence[Mapping[str, Any]]) -> list[Item]:
    if not shown:
        return []
    lines = []
    for number, flight in enumerate(shown):
        recovery_s = flight["recovery_time_s"]
        lines.append((
            Cell("", html=f'<button data-flight="{number}">Show</button>'),
            *(flight["reaction"], flight["kind"], flight["case"]),
            "crashed" if flight["crashed"] else "did not crash",
            f"{flight['max_falling_distance_m']:.2f}",
            "–" if recovery_s is None else f"{recovery_s:.2f}",
            Cell(flight["command"], code=True),
        ))  # fmt: skip
    head = ("", "reaction", "flight", "case", "", "fall [m]", "recovery [s]", "flies it again")
    meaning = (
        "Of the collisions in the table: typical has the median fall, worst is a crash if there "
        "is one, and of these the one that falls farthest."
    )
    return [Table(head, lines, "replays", note=meaning), Markup(asset("stage.html"))]


def _again(study: ArenaStudy, shown: Mapping[str, Any]) -> Flight:
    match = next(
        m for m in study.matches if (m.reaction, m.case.name) == (shown["reaction"], shown["case"])
    )
    return fly_scenario(match.scenario(), int(shown["seed"]))


_COLOURS: Final = (style.PURPLE, style.BLUE, style.GREEN, style.SKY, style.INK)
"""Far from the red of crashes."""
_LEAST_FALL_M: Final = 0.01
"""Smaller falls are drawn at the left end of the logarithmic axis."""
_FALL_TICKS: Final = (0.01, 0.03, 0.1, 0.3, 1.0, 2.0)
_CRASH_MAP: Final = LinearSegmentedColormap.from_list(
    "crash rate", [style.PAPER, "#F9D9BF", "#EE9A5B", style.VERMILLION, "#7A2E00"]
)
Rows = Mapping[str, Sequence[Mapping[str, Any]]]
"""Reaction → its flights."""


def reaction_colours(reactions: Sequence[str]) -> dict[str, str]:
    """Return a colour for each reaction; doing nothing is grey."""
    acting = [name for name in reactions if name != NoReaction.name]
    found = {name: _COLOURS[i % len(_COLOURS)] for i, name in enumerate(acting)}
    return {name: found.get(name, style.MUTED) for name in reactions}


def draw_histograms(flights: Rows) -> Figure:
    """Draw histograms of fall and recovery time, a row a reaction; crashed flights stand out."""
    colours = reaction_colours(list(flights))
    times = [r["recovery_time_s"] for rows in flights.values() for r in rows]
    longest = max([t for t in times if t is not None], default=5.0)
    bins = {
        "max_falling_distance_m": np.geomspace(_LEAST_FALL_M, 2.5, 41),
        "recovery_time_s": np.linspace(0.0, max(1.0, np.ceil(longest)), 49),
    }
    labels = ("largest falling distance [m]", "recovery, from contact to settled at x_r [s]")
    with new_figure(11.0, 0.9 + 1.35 * len(flights), 130, layout="constrained") as figure:
        axes = figure.subplots(len(flights), 2, squeeze=False, sharex="col")
        for row, (name, rows) in zip(axes, flights.items(), strict=True):
            for panel, key, edges in zip(row, bins, bins.values(), strict=True):
                _histogram(panel, rows, key, edges, colours[name])
            row[0].set_ylabel(f"{name}\nflights", fontweight="bold")
        for panel, label in zip(axes[-1], labels, strict=True):
            panel.set_xlabel(label)
        for panel in axes[:, 0]:
            panel.set_xscale("log")
            panel.set_xlim(_LEAST_FALL_M, 2.5)
            panel.xaxis.set_major_locator(FixedLocator(_FALL_TICKS))
            panel.xaxis.set_minor_locator(NullLocator())
            panel.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    return figure


def _histogram(
    axes: Axes, rows: Sequence[Mapping[str, Any]], key: str, edges: Array, colour: str
) -> None:
    values = [
        np.clip(
            [r[key] for r in rows if r["crashed"] is gone and r[key] is not None], *edges[[0, -1]]
        )
        for gone in (False, True)
    ]
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=4))
    if not values[0].size + values[1].size:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", color=style.MUTED)
        axes.set_yticks([])
        return
    axes.hist(
        values,
        edges.tolist(),
        stacked=True,
        color=[colour, style.VERMILLION],
        label=["flights", "crashed"],
    )
    low, median, high = np.percentile(np.concatenate(values), (5.0, 50.0, 95.0))
    axes.axvline(median, color=style.INK, lw=1.2)
    crashes = f", {values[1].size} crashed" if values[1].size else ""
    axes.set_title(
        f"median {median:.2f}, 5 to 95 %: {low:.2f} to {high:.2f}; "
        f"{values[0].size + values[1].size} flights{crashes}",
        loc="left",
        fontsize=8.0,
        color=style.MUTED,
    )


def draw_map(results: Mapping[str, Any], group: str, x_label: str, y_label: str) -> Figure:
    """Draw the crash rate over the two quantities of a map, a panel a reaction."""
    reactions = results["reactions"]
    columns = min(3, len(reactions))
    lines = -(-len(reactions) // columns)
    with new_figure(0.9 + 3.5 * columns, 0.6 + 2.9 * lines, 130, layout="constrained") as figure:
        panels = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True)
        for panel in panels.flat[len(reactions) :]:
            panel.set_visible(False)
        for panel, name in zip(panels.flat, reactions, strict=False):
            found = [
                r for r in results["results"] if r["group"] == group and r["reaction"] == name
            ]
            image = _draw_cells(panel, found)
            crashed, flown = (sum(r[key] for r in found) for key in ("crashed", "flights"))
            panel.set_title(f"{name}: {crashed} of {flown} crashed", loc="left", fontweight="bold")
            panel.set_xlabel(x_label)
        for panel in panels[:, 0]:
            panel.set_ylabel(y_label)
        bar = figure.colorbar(image, ax=panels, shrink=0.9, pad=0.015)
        bar.set_label("crashed [%]")
        bar.outline.set_visible(False)  # type: ignore[operator]
    return figure


def _draw_cells(axes: Axes, found: Sequence[Mapping[str, Any]]) -> Any:
    xs, ys = (sorted({r["place"][i] for r in found}) for i in (0, 1))
    share = np.full((len(ys), len(xs)), np.nan)
    for r in found:
        cell = ys.index(r["place"][1]), xs.index(r["place"][0])
        share[cell] = 100.0 * r["crash_rate"]
        axes.text(
            *(cell[1], cell[0], f"{share[cell]:.0f}"),
            ha="center",
            va="center",
            color=style.PAPER
            if share[cell] > 55.0
            else style.INK
            if r["crashed"]
            else style.MUTED,
        )
    image = axes.imshow(
        share, origin="lower", aspect="auto", cmap=_CRASH_MAP, vmin=0.0, vmax=100.0
    )
    axes.set_xticks(range(len(xs)), [f"{x:g}" for x in xs])
    axes.set_yticks(range(len(ys)), [f"{y:g}" for y in ys])
    axes.grid(visible=False)
    axes.set_xticks(np.arange(len(xs) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(ys) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color=style.FAINT, lw=0.8)
    axes.tick_params(which="both", length=0)
    return image


def draw_configurations(results: Mapping[str, Any]) -> Figure:
    """Draw crash rate with interval, and fall with its range, of each configuration."""
    found = [r for r in results["results"] if r["group"] == CONFIGURATIONS]
    colours = reaction_colours(results["reactions"])
    names = [*dict.fromkeys(r["case"] for r in found), *results["refused"]]
    names = sorted({n for n in names if n.startswith("Conf. ")}, key=lambda n: int(n[6:]))
    with new_figure(11.0, 5.0, 130, layout="constrained") as figure:
        crash, fall = figure.subplots(2, 1, sharex=True)
        for number, (reaction, colour) in enumerate(colours.items()):
            rows = [r for r in found if r["reaction"] == reaction]
            shift = 0.16 * (number - 0.5 * (len(colours) - 1))
            at = np.array([names.index(r["case"]) + shift for r in rows])
            values = [[100.0 * v for v in (r["crash_rate"], *r["crash_rate_95"])] for r in rows]
            _with_range(crash, at, values, colour, reaction)
            falls = [r["max_falling_distance_m"] for r in rows]
            spreads = [[v[key] or 0.0 for key in ("median", "p05", "p95")] for v in falls]
            _with_range(fall, at, spreads, colour, reaction)
        for i, name in enumerate(names):
            if name in results["refused"]:
                for axes in (crash, fall):
                    axes.axvspan(i - 0.5, i + 0.5, color=style.FAINT, alpha=0.5, lw=0.0)
                crash.text(
                    i, 50.0, "can't lift\nthe vehicle", ha="center", va="center", color=style.MUTED
                )
        crash.set(ylim=(-4.0, 104.0), ylabel="crashed [%], 95 % interval")
        fall.set(ylabel="largest fall [m]\nmedian, 5 to 95 %", xlim=(-0.5, len(names) - 0.5))
        fall.set_ylim(bottom=0.0)
        fall.set_xticks(range(len(names)), names)
        for axes in (crash, fall):
            axes.grid(visible=False, axis="x")
        figure.legend(*crash.get_legend_handles_labels(), loc="outside upper left", ncols=6)
    return figure


def _with_range(
    axes: Axes, at: Array, values: Sequence[Sequence[float]], colour: str, label: str
) -> None:
    """Draw points (value, low, high) with their range."""
    value, low, high = np.array(values, dtype=np.float64).reshape(-1, 3).T
    axes.vlines(at, low, high, color=colour, lw=2.0, alpha=0.55)
    axes.plot(at, value, "o", color=colour, ms=5.0, label=label)

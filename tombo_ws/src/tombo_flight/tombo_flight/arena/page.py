"""The page of an arena: one HTML file that needs nothing but a browser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, Final

from tombo_bag.flight import Flight
from tombo_flight.arena.cases import ANGLE_RADIUS, COLLISIONS, CONFIGURATIONS, FREE, SPEED_OFFSET
from tombo_flight.arena.flying import Plan, Row
from tombo_flight.arena.pictures import draw_configurations, draw_histograms, draw_map
from tombo_flight.arena.table import HEAD, MEANING, crashed, table_rows
from tombo_flight.flight import fly_scenario
from tombo_flight.report.flight_plot import figure_bytes
from tombo_flight.report.flight_report import replay_scripts, replay_stage
from tombo_flight.report.html_page import Card, Page, hint, page_html, pictures, sentences, table

_CSS: Final = """
header, main, footer { max-width: 1400px; }
.arena { font-size: 0.78rem; width: 100%; }
.arena thead th { vertical-align: bottom; padding: 0.22rem 0.7rem 0.22rem 0; }
.arena td, .arena tbody th { padding: 0.22rem 0.7rem 0.22rem 0; }
.arena td:first-of-type, .arena tbody th { white-space: nowrap; }
.arena tbody th { vertical-align: top; }
.arena .first > * { border-top: 1.5px solid var(--muted); }
.arena tr:not(.last) > td { border-bottom: 0; }
.arena .lost { color: var(--bad); font-weight: 600; }
.replays td { vertical-align: middle; } .replays code { font-size: 0.82em; user-select: all; }
.stage .view .key { display: none; }
"""
_FOOTER: Final = (
    "Ground truth of simulated flights. Cells of the maps fly a third of the seeds. The same "
    "figures in arena.json, each flight in flights.jsonl; the maps' exact numbers stand there too."
)
_MAPS: Final = (
    (
        *(SPEED_OFFSET, "approach speed [m/s]", "y of the pillar's axis [m]"),
        "Crash rate over approach speed and lateral place of the pillar, in percent; the paper's "
        "pillar stands at y = 0.27 m and is flown at 0.7 m/s. At y = 0 both front discs touch",
    ),
    (
        *(ANGLE_RADIUS, "angle from the nose to the course [°]", "radius of the obstacle [m]"),
        "Crash rate over angle of approach and radius, in percent. The disc that is foremost "
        "touches, at the paper's point and in the paper's direction off the course",
    ),
)


def arena_html(results: Mapping[str, Any], plan: Plan, kept: Mapping[str, Row]) -> str:
    """Return the page as text; it loads nothing from anywhere.

    Args:
        results: of `arena_results`.
        plan: what was flown; the flights of the replay are flown again.
        kept: the rows of its flights.

    Raises:
        InputError: as `fly_scenario`.
    """
    shown = results["shown"]
    records = [_again(plan, one) for one in shown]
    return page_html(
        Page(
            title=f"Tombo arena: {', '.join(results['reactions'])}",
            eyebrow="Tombo arena",
            headline=headline(results),
            summary=_summary(results),
            cards=[_card(name, results["collisions"][name]) for name in results["reactions"]],
            sections=(
                ("Figures", _figures(results, (COLLISIONS, FREE))),
                ("Fall and recovery", _histograms(results, plan, kept)),
                *(
                    (title, _map(results, *of))
                    for title, of in zip(_MAP_TITLES, _MAPS, strict=True)
                ),
                ("Configurations 1 to 13", _configurations(results)),
                ("Typical and worst flight of each reaction", _replays(shown)),
                ("Not flown", sentences(f"{k}: {v}" for k, v in results["refused"].items())),
            ),
            footer=_FOOTER,
            css=_CSS,
            scripts=replay_scripts(records) if records else "",
        )
    )


_MAP_TITLES: Final = ("Speed and lateral offset", "Angle of approach and radius")


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
        crashed(pooled) + beside,
        tooltip="over all flights of the table's collisions",
    )


def _figures(results: Mapping[str, Any], groups: Sequence[str]) -> str:
    lines = []
    for case, rows in table_rows(results, groups):
        for i, row in enumerate(rows):
            place = "first" if i == 0 else ""
            place += " last" if i == len(rows) - 1 else ""
            name = (
                f'<th scope="rowgroup" rowspan="{len(rows)}">{escape(case)}</th>' if i == 0 else ""
            )
            lost = "" if row[1].startswith("0 ") else ' class="lost"'
            cells = "".join(
                f"<td{lost if n == 1 else ''}>{escape(text)}</td>" for n, text in enumerate(row)
            )
            lines.append(f'<tr class="{place.strip()}">{name}{cells}</tr>')
    return table(("case", *HEAD), lines, "arena") + hint(MEANING) if lines else ""


def _histograms(results: Mapping[str, Any], plan: Plan, kept: Mapping[str, Row]) -> str:
    flights: dict[str, list[Row]] = {name: [] for name in results["reactions"]}
    for match, rows in plan.rows(kept).items():
        if match.case.group == COLLISIONS:
            flights[match.reaction] += rows
    if not any(flights.values()):
        return ""
    caption = "All flights of the collisions in the table; the line is the median, crashed in red"
    return pictures([(figure_bytes(draw_histograms(flights)), "", caption)])


def _map(results: Mapping[str, Any], group: str, x: str, y: str, caption: str) -> str:
    if not any(r["group"] == group for r in results["results"]):
        return ""
    return pictures([(figure_bytes(draw_map(results, group, x, y)), "", caption)])


def _configurations(results: Mapping[str, Any]) -> str:
    if not any(r["group"] == CONFIGURATIONS for r in results["results"]):
        return ""
    caption = "The paper's collision with each configuration of its Table I"
    drawn = pictures([(figure_bytes(draw_configurations(results)), "", caption)])
    figures = _figures(results, (CONFIGURATIONS,))
    return f"{drawn}<details><summary>In figures</summary>{figures}</details>"


def _replays(shown: Sequence[Mapping[str, Any]]) -> str:
    if not shown:
        return ""
    lines = []
    for number, one in enumerate(shown):
        fate = "crashed" if one["crashed"] else "did not crash"
        words = (
            *(one["reaction"], one["kind"], one["case"], fate),
            f"{one['max_falling_distance_m']:.2f}",
            "–" if one["recovery_time_s"] is None else f"{one['recovery_time_s']:.2f}",
        )
        cells = "".join(f"<td>{escape(str(word))}</td>" for word in words)
        lines.append(
            f'<tr><td><button data-flight="{number}">Show</button></td>{cells}'
            f"<td><code>{escape(one['command'])}</code></td></tr>"
        )
    head = ("", "reaction", "flight", "case", "", "fall [m]", "recovery [s]", "flies it again")
    meaning = hint(
        "Of the collisions in the table: typical has the median fall, worst is a crash if there "
        "is one, and of these the one that falls farthest."
    )
    return table(head, lines, "replays") + meaning + replay_stage()


def _again(plan: Plan, one: Mapping[str, Any]) -> Flight:
    match = next(
        m for m in plan.matches if (m.reaction, m.case.name) == (one["reaction"], one["case"])
    )
    return fly_scenario(match.scenario(), int(one["seed"]))

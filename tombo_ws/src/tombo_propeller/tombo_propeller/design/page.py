"""The design on one page: an HTML file that needs nothing but a browser, and no script."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from tombo_flight.report.html_page import (
    Card,
    Page,
    command,
    hint,
    page_html,
    pictures,
    sentences,
    table,
)
from tombo_propeller.design import summary_text as words
from tombo_propeller.design import table_cells
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Check
from tombo_propeller.design.flight_files import SCENARIO
from tombo_propeller.design.recommend import Recommendation
from tombo_propeller.design.request import QUANTITIES

_FOOTER = (
    "Thrust margin and lift over drag are the model's; collision force, recovery time and noise "
    "are Table III's, at 2000 rpm, or predicted from it. The same in design.json."
)


def design_html(found: Design, made: Recommendation, png: Sequence[bytes]) -> str:
    """Return the page as text; it loads nothing from anywhere.

    Args:
        found: the design.
        made: the recommendation.
        png: the pictures of `draw_pareto` and `draw_readings`.
    """
    good = made.index is not None
    vehicle = f"{found.request.mass_kg:g} kg, arms of {1e3 * found.request.arm_m:g} mm"
    asked = ", ".join(limit.text for limit in found.choice.limits)
    pareto, readings = png
    known = sentences(words.sources(found)) + pictures([(readings, "", "What predicts a reading")])
    return page_html(
        Page(
            title=f"Design: {words.headline(found, made)}",
            eyebrow="Tombo propeller design",
            headline=words.headline(found, made),
            summary=f"{vehicle}: {asked}. Law {found.request.law}.",
            cards=_cards(found, made.index),
            sections=(
                ("Why", sentences(words.reasons(found, made) + words.relief_lines(found))),
                ("What can be had", pictures([(pareto, "", "Figures against thrust margin")])),
                ("Fly it, in this folder", command(f"tombo fly {SCENARIO}") if good else ""),
                ("Claimed and simulated", _check(made.check)),
                ("Candidates", _candidates(found, made)),
                ("Not measured", sentences(words.caveats(found, made))),
                ("Where the predictions come from", known),
            ),
            footer=_FOOTER,
            verdict="recommended" if good else "nothing fits",
            verdict_class="good" if good else "bad",
        )
    )


def _cards(found: Design, index: int | None) -> list[Card]:
    if index is None:
        return []
    values = [float(v) for v in found.judged.value[index]]
    return [
        Card(q.words, table_cells.figure(v, q), q.unit, table_cells.known(found, index, k))
        for k, (q, v) in enumerate(zip(QUANTITIES, values, strict=True))
    ]


def _check(check: Check | None) -> str:
    if check is None:
        return ""
    rows = [
        f'<tr><th scope="row">{escape(c.text)}</th><td>{c.claimed:.4g} {escape(c.unit)}</td>'
        f"<td>{c.simulated:.4g} {escape(c.unit)}</td>"
        f"<td>{'held' if c.held else 'broken'}</td></tr>"
        for c in (*check.claims, *check.limits)
    ]
    falls = "" if check.falls_m is None else f" Falls {check.falls_m:.2f} m at most."
    return table(("", "claimed", "simulated", ""), rows) + hint(
        f"{len(check.seeds)} flights into the pillar.{falls}"
    )


def _candidates(found: Design, made: Recommendation) -> str:
    head = ("candidate", *(f"{q.words} {q.unit}".strip() for q in QUANTITIES), "")
    rows = []
    for index, why in table_cells.shown(found, made):
        row = "".join(
            f"<td>{escape(table_cells.cell(found, index, k))}</td>" for k in range(len(QUANTITIES))
        )
        rows.append(
            f'<tr><th scope="row">{escape(table_cells.label_of(found, index))}</th>{row}'
            f"<td>{escape(why)}</td></tr>"
        )
    return table(head, rows) + hint(table_cells.KEY)

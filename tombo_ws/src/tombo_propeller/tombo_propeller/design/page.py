"""The design on one page: an HTML file that needs nothing but a browser, and no script."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

from tombo_flight.report.flight_report import asset, fill
from tombo_propeller.design import summary_text as words
from tombo_propeller.design import table_cells
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Check
from tombo_propeller.design.flight_files import SCENARIO
from tombo_propeller.design.recommend import Recommendation
from tombo_propeller.design.request import QUANTITIES

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; \
style-src 'unsafe-inline'; img-src data:">
<meta name="color-scheme" content="light dark">
<title>{{title}}</title>
<link rel="icon" href="data:,">
<style>
{{css}}
img { max-width: 100%; background: #fff; border-radius: 6px; }
</style>
</head>
<body>
<header>
  <p class="eyebrow">Tombo propeller design \
<span class="verdict {{kind}}">{{verdict}}</span></p>
  <h1 class="large">{{headline}}</h1>
  <p class="summary">{{request}}</p>
  {{cards}}
</header>
<main>{{panels}}</main>
<footer><p>Thrust margin and lift over drag are the model's; collision force, recovery time and
noise are Table III's, at 2000 rpm, or predicted from it. The same in design.json.</p></footer>
</body>
</html>
"""


def design_html(found: Design, made: Recommendation, pictures: Sequence[bytes]) -> str:
    """Return the page as text; it loads nothing from anywhere.

    Args:
        found: the design.
        made: the recommendation.
        pictures: PNG files that the page carries.
    """
    good = made.index is not None
    panels = [
        _panel("Why", _list(words.reasons(found, made) + words.relief_lines(found))),
        _panel("What can be had", _picture(pictures[0])),
        _panel("Claimed and simulated", _check(made.check)),
        _panel("Candidates", _candidates(found, made)),
        _panel("What nobody knows", _list(words.caveats(found, made))),
        _panel("Where the predictions come from", _list(words.sources(found)))
        if len(pictures) < 2
        else _panel(
            "Where the predictions come from",
            _list(words.sources(found)) + _picture(pictures[1]),
        ),
    ]
    if good:
        command = f'<pre class="command">tombo fly {SCENARIO}</pre>'
        panels.insert(2, _panel("Fly it, in this folder", command))
    vehicle = f"{found.request.mass_kg:g} kg, arms of {1e3 * found.request.arm_m:g} mm"
    asked = ", ".join(limit.text for limit in found.choice.limits)
    return fill(
        _PAGE,
        {
            "title": escape(f"Design: {words.headline(found, made)}"),
            "css": asset("report.css") + asset("diagnosis.css", "tombo_diagnosis.report"),
            "kind": "good" if good else "bad",
            "verdict": "recommended" if good else "nothing fits",
            "headline": escape(words.headline(found, made)),
            "request": escape(f"{vehicle}: {asked}. Law {found.request.law}."),
            "cards": _cards(found, made.index),
            "panels": "".join(panels),
        },
    )


def _cards(found: Design, index: int | None) -> str:
    if index is None:
        return ""
    cards = []
    for k, quantity in enumerate(QUANTITIES):
        value = table_cells.figure(float(found.judged.value[index, k]), quantity)
        small = f"<small> {escape(quantity.unit)}</small>" if quantity.unit else ""
        cards.append(
            f'<div class="card"><span class="name">{escape(quantity.words)}</span>'
            f'<span class="value">{escape(value)}{small}</span>'
            f'<span class="beside">{escape(table_cells.known(found, index, k))}</span></div>'
        )
    return f'<div class="cards">{"".join(cards)}</div>'


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
    return (
        _table(("", "claimed", "simulated", ""), rows)
        + f'<p class="hint">{len(check.seeds)} flights into the pillar.{escape(falls)}</p>'
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
    return _table(head, rows) + f'<p class="hint">{table_cells.KEY}</p>'


def _table(head: Sequence[str], rows: Sequence[str]) -> str:
    top = "".join(f'<th scope="col">{escape(h)}</th>' for h in head)
    return (
        f'<div style="overflow-x:auto"><table><thead><tr>{top}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _picture(png: bytes) -> str:
    code = base64.b64encode(png).decode("ascii")
    return f'<img alt="figure" src="data:image/png;base64,{code}">'


def _list(lines: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def _panel(title: str, content: str) -> str:
    if not content:
        return ""
    return f'<section class="panel"><h2>{escape(title)}</h2>{content}</section>'

"""The reproduction as one self-contained HTML page: verdicts first, then figures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import escape
from typing import Final

from tombo_flight.report.html_page import Card, Page, asset, page_html, pictures, table
from tombo_propeller.reproduce.claims.claim import DATA, FAILS, HOLDS, OPEN, Claim
from tombo_propeller.reproduce.plots import FIGURES
from tombo_propeller.reproduce.reproduction import GROUPS, Reproduction
from tombo_propeller.reproduce.summary_text import (
    KINDS,
    LABELS,
    MARKS,
    headline,
    summary,
    with_unit,
)

_CLASSES: Final = {HOLDS: "good", FAILS: "bad", OPEN: "open"}
_KEY_CLAIMS: Final = {
    "table_1": "Table I, moduli",
    "table_3_lift_over_drag": "Table III, lift over drag",
    "eps_mld": "largest lift over drag",
    "thrust_error_table_3": "largest thrust error",
    "collision_force": "collision force over rigid",
    "mean_recovery_time": "mean recovery time",
}
"""Claims whose figures are in the header -> how they are called there."""
_FOOTER: Final = (
    "A claim about numbers of the paper’s model is judged by law published, the authors’ program "
    "with its defects; beside it stand the laws with the defects mended. ✓ holds, ✗ fails, "
    "? can’t be checked under that law. Nothing here was measured again. The same in "
    "reproduction.json, beside this page."
)


def reproduction_html(r: Reproduction, png: Mapping[str, bytes]) -> str:
    """Return the page as text; it loads nothing from anywhere.

    Args:
        r: the reproduction.
        png: pictures by the names in `FIGURES`.
    """
    figures = [(png[name], of_paper, caption) for name, (_, caption, of_paper) in FIGURES.items()]
    return page_html(
        Page(
            title=headline(r),
            eyebrow=f"Tombo propeller · the paper against {', '.join(r.numbers.laws)}",
            headline=headline(r),
            summary=summary(r),
            cards=_cards(r),
            sections=(
                ("Verdicts", _board(r)),
                ("Claim by claim, with the evidence", _claims(r)),
                ("The paper’s figures, drawn again", pictures(figures)),
            ),
            footer=_FOOTER,
            css=asset("reproduction.css", __package__),
        )
    )


def _cards(r: Reproduction) -> list[Card]:
    found = []
    for name, label in _KEY_CLAIMS.items():
        claim = r.claim(name)
        value = with_unit(claim.computed[claim.judge], claim.unit)
        whole = re.search(r", (of \d+)$", claim.quantity)
        value += f" {whole[1]}" if whole else ""
        law = "" if claim.judge == DATA else f"law {claim.judge} · "
        beside = f"{law}paper {claim.paper}"
        found.append(Card(label, value, "", beside, _CLASSES[claim.verdict]))
    return found


def _board(r: Reproduction) -> str:
    """Return all claims in three columns, by verdict: the paper's first, then our checks."""
    columns = []
    for verdict in (FAILS, HOLDS, OPEN):
        found = [claim for claim in r.claims if claim.verdict == verdict]
        found.sort(key=lambda claim: claim.kind == "check")
        items = "".join(_item(claim) for claim in found)
        chip = f'<span class="verdict {_CLASSES[verdict]}">{escape(LABELS[verdict])}</span>'
        columns.append(f"<div><h3>{chip} {len(found)}</h3><ul>{items}</ul></div>")
    return f'<div class="board">{"".join(columns)}</div>'


def _item(claim: Claim) -> str:
    notes = [f"only {claim.law}"] if claim.disputed and claim.law else []
    notes += ["our check"] if claim.kind == "check" else []
    small = f" <small>{escape(', '.join(notes))}</small>" if notes else ""
    return f'<li><a href="#{escape(claim.name)}">{escape(claim.claim)}</a>{small}</li>'


def _claims(r: Reproduction) -> str:
    laws = list(r.numbers.laws)
    lines: list[str] = []
    for group in GROUPS:
        claims = [claim for claim in r.claims if claim.group == group]
        if claims:
            lines.append(
                f'<tr class="group"><th colspan="{4 + len(laws)}">{escape(group)}</th></tr>'
            )
            lines += [_line(claim, laws) for claim in claims]
    return table(("verdict", "claim", "paper", *laws, "evidence"), lines, "claims")


def _line(claim: Claim, laws: list[str]) -> str:
    chip = (
        f'<span class="verdict {_CLASSES[claim.verdict]}">{escape(LABELS[claim.verdict])}</span>'
    )
    if claim.disputed and claim.law:
        chip += f'<span class="law">only {escape(claim.law)}</span>'
    if claim.judge == DATA:
        value = with_unit(claim.computed[DATA], claim.unit)
        cells = f'<td colspan="{len(laws)}" class="number">{escape(value)}</td>'
    else:
        cells = "".join(
            f'<td class="number {_CLASSES[claim.verdicts[law]]}">'
            f"{escape(with_unit(claim.computed[law], claim.unit))} "
            f"<i>{MARKS[claim.verdicts[law]]}</i></td>"
            for law in laws
        )
    about = f"{KINDS[claim.kind]} · {claim.source}"
    return (
        f'<tr id="{escape(claim.name)}"><td>{chip}</td>'
        f'<th scope="row">{escape(claim.claim)}<small>{escape(about)}</small></th>'
        f"<td>{escape(claim.paper)}</td>{cells}"
        f"<td>{escape(claim.evidence)}<small>Compared: {escape(claim.quantity)}. Tolerance: "
        f"{escape(claim.tolerance)}.</small></td></tr>"
    )

"""The reproduction as a page of results: verdicts first, then figures; and its files."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tombo_flight.progress import ProgressCallback
from tombo_flight.report.page import (
    Cell,
    Item,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
    page_json,
    write_page,
)
from tombo_flight.report.style import figure_bytes
from tombo_propeller.reproduce.claims.claim import DATA, FAILS, HOLDS, OPEN, Claim
from tombo_propeller.reproduce.plots import FIGURES
from tombo_propeller.reproduce.reproduction import GROUPS, Reproduction, checks_summary, headline

if TYPE_CHECKING:
    from tombo_flight.process.output_folder import OutputFolder

JSON: Final = "reproduction.json"
PAGE: Final = "reproduction.html"
REPRODUCTION_FILES: Final = (JSON, PAGE, *FIGURES)
"""All names that a reproduction writes: those of an earlier one give way."""
_LABELS: Final = {HOLDS: "holds", FAILS: "fails", OPEN: "can’t be checked"}
_MARKS: Final = {HOLDS: "✓", FAILS: "✗", OPEN: "?"}
_STYLES: Final = {HOLDS: "good", FAILS: "bad", OPEN: "warn"}
KINDS: Final = {"printed": "printed number", "stated": "statement", "check": "our check"}
_FOOTER: Final = (
    "A claim about numbers of the paper’s model is judged by law published, the authors’ program "
    "with its defects; beside it stand the laws with the defects mended. ✓ holds, ✗ fails, "
    "? can’t be checked under that law. Nothing here was measured again. The same in "
    "reproduction.json, beside this page."
)


def reproduction_page(r: Reproduction) -> Page:
    """Return the result of a reproduction."""
    figures = [
        Picture(partial(draw, r), caption, of_paper)
        for draw, caption, of_paper in FIGURES.values()
    ]
    return Page(
        title=headline(r),
        eyebrow=f"Tombo propeller · the paper against {', '.join(r.numbers.laws)}",
        headline=headline(r),
        summary=f"{checks_summary(r)} Twist, torque and thrust above 3200 rpm were not measured: "
        "there the laws differ.",
        sections=[
            Section("Claim by claim, with the evidence", [_claim_table(r)], "page"),
            *(Section(group, _in_words(r, group), "terminal") for group in GROUPS),
            Section("The paper’s figures, drawn again", figures),
        ],
        data=r.mapping(),
        footer=_FOOTER,
        css=(Path(__file__).parent / "assets" / "reproduction.css").read_text(encoding="utf-8"),
    )


def write_reproduction(
    folder: OutputFolder, r: Reproduction, on_progress: ProgressCallback
) -> None:
    """Write all files into an output folder, which the caller publishes."""
    for k, (name, (draw, _, _)) in enumerate(FIGURES.items()):
        on_progress(f"drawing {name}", k / len(FIGURES))
        (folder / name).write_bytes(figure_bytes(draw(r)))
    page = reproduction_page(r)
    (folder / JSON).write_text(page_json(page), encoding="utf-8", newline="\n")
    write_page(folder / PAGE, page)


def _claim_table(r: Reproduction) -> Table:
    laws = list(r.numbers.laws)
    rows: list[TableRow] = []
    for group in GROUPS:
        claims = [claim for claim in r.claims if claim.group == group]
        if claims:
            rows.append(TableRow([group], "group"))
            rows += [_claim_row(claim, laws) for claim in claims]
    return Table(("verdict", "claim", "paper", *laws, "evidence"), rows, "claims")


def _claim_row(claim: Claim, laws: list[str]) -> TableRow:
    if claim.deciding_law == DATA:
        value = with_unit(claim.computed[DATA], claim.unit)
        computed = [Cell(value), *([Cell("")] * (len(laws) - 1))]
    else:
        computed = [
            Cell(
                f"{with_unit(claim.computed[law], claim.unit)} {_MARKS[claim.verdicts[law]]}",
                _STYLES[claim.verdicts[law]],
            )
            for law in laws
        ]
    law = f"only {claim.law}" if claim.disputed and claim.law else ""
    compared = f"Compared: {claim.quantity}. Tolerance: {claim.tolerance}."
    return TableRow(
        [
            Cell(_LABELS[claim.verdict], _STYLES[claim.verdict], small=law, badge=True),
            Cell(claim.claim, small=f"{KINDS[claim.kind]} · {claim.source}"),
            claim.paper,
            *computed,
            Cell(claim.evidence, small=compared),
        ],
        anchor=claim.name,
    )


def _in_words(r: Reproduction, group: str) -> list[Item]:
    """Return the claims of a group as sentences: no terminal is as wide as their table."""
    items: list[Item] = []
    for claim in r.claims:
        if claim.group == group:
            verdict = f"{_MARKS[claim.verdict]} {verdict_text(claim)}"
            about = [
                f"{verdict}: {claim.claim} ({claim.source}).",
                f"  Paper: {claim.paper}. Computed: {computed_text(claim)}.",
            ]
            items += [
                Text(about, style=_STYLES[claim.verdict]),
                Text([f"  {claim.evidence}"], "hint"),
            ]
    return items


def _shown(value: float | None) -> str:
    """Return a computed number with the digits that matter."""
    if value is None:
        return "none"
    if abs(value) < 1e-12:
        return "0"  # rounding, another on each machine
    if value == round(value) and abs(value) < 1e6:
        return f"{value:.0f}"
    if abs(value) < 1e-3:
        return f"{value:.0e}"
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def with_unit(value: float | None, unit: str) -> str:
    """Return a computed number with its unit, that of a pure number left out."""
    if value is None:
        return "none"
    sign = {"deg": "°", "1": ""}.get(unit, f" {unit}")
    return f"{'−' if value < 0.0 else ''}{_shown(abs(value))}{sign}"


def verdict_text(claim: Claim) -> str:
    """Return the verdict, and under which laws it stands if another law says otherwise."""
    text = _LABELS[claim.verdict]
    return f"{text} ({claim.law})" if claim.disputed and claim.law else text


def computed_text(claim: Claim) -> str:
    """Return the computed numbers by law, or the one number where no law is concerned."""
    if claim.deciding_law == DATA:
        return with_unit(claim.computed[DATA], claim.unit)
    values = {with_unit(v, claim.unit) for v in claim.computed.values()}
    if len(values) == 1:
        return f"{values.pop()} in every law" if len(claim.computed) > 1 else values.pop()
    return ", ".join(f"{law} {with_unit(v, claim.unit)}" for law, v in claim.computed.items())

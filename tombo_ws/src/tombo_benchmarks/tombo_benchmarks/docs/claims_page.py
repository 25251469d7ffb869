"""The table of all claims in `docs/reproduction.md`, between two marks."""

from __future__ import annotations

from typing import Final

from tombo_propeller.reproduce.page import computed_text, headline, verdict_text
from tombo_propeller.reproduce.reproduction import GROUPS, Reproduction

START: Final = "<!-- claims: written by `make docs ARGS=reproduction` -->"
END: Final = "<!-- end of claims -->"


def claims_markdown(r: Reproduction) -> str:
    """Return the claims as Markdown: a sentence, then a table for each group."""
    parts = [f"{headline(r)}.\n"]
    for group in GROUPS:
        claims = [claim for claim in r.claims if claim.group == group]
        if not claims:
            continue
        lines = [f"### {group}", ""]
        lines += ["| claim | paper | computed | verdict | evidence |", "|---|---|---|---|---|"]
        for c in claims:
            cells = (
                f"{c.claim} ({c.source})",
                c.paper,
                computed_text(c),
                f"**{verdict_text(c)}**",
                c.evidence,
            )
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def with_claims(page: str, r: Reproduction) -> str:
    """Return a page with the table between its marks renewed."""
    before, _, rest = page.partition(START)
    _, _, after = rest.partition(END)
    return f"{before}{START}\n{claims_markdown(r)}\n{END}{after}"

"""What is left over, as HTML text: picture, terms, and the effect to paste; escaped here."""

from __future__ import annotations

from html import escape

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.leftover.leftover import FittedTerm, Leftover
from tombo_diagnosis.wording import figure, percent, unit
from tombo_flight.report.html_page import command, hint, pictures, table


def leftover(diagnosis: Diagnosis) -> str:
    """Return the leftover of flights that are not fully explained; empty for others."""
    found = diagnosis.leftover
    if found is None:
        return ""
    from tombo_diagnosis.report.leftover_plot import draw_leftover
    from tombo_flight.report.flight_plot import figure_bytes

    caption = "What is left over against what could drive it, all flights"
    drawn = pictures([(figure_bytes(draw_leftover(diagnosis)), "A drawn guess", caption)])
    return f"{drawn}{_terms(found)}{_effect(found)}"


def _terms(found: Leftover) -> str:
    if not found.terms:
        return hint("No term of the dictionary predicts the leftover in flights held out.")
    lines = [_term(term, found.r2[term.quantity]) for term in found.terms]
    head = ("term", "coefficient", "95 % interval", "times", "R², held out", "remark")
    return table(head, lines, "leftover")


def _term(term: FittedTerm, r2: float) -> str:
    return (
        f'<tr><th scope="row">{escape(f"{term.quantity}: {term.name}")}</th>'
        f"<td><b>{figure(term.value)}</b>&nbsp;{escape(unit(term.unit))}</td>"
        f"<td>{figure(term.low)} to {figure(term.high)}</td>"
        f"<td><code>{escape(term.formula)}</code></td><td>{percent(r2)}</td>"
        f"<td>{escape(term.remark)}</td></tr>"
    )


def _effect(found: Leftover) -> str:
    if not found.effect:
        return ""
    text = (
        "A first guess of the missing effect, ready to paste as a file under "
        "tombo_dynamics/effects/ (CONTRIBUTING.md, Adding an effect):"
    )
    return f"<details><summary>as an effect</summary>{hint(text)}{command(found.effect)}</details>"

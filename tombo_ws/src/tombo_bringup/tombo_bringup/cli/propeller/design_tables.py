"""A design on the terminal: the nodus, the reasons, the simulated flights, what is unknown."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from tombo_bringup.cli.tables import console, print_line, right
from tombo_flight.command_line import command_line
from tombo_propeller.design import summary_text as words
from tombo_propeller.design import table_cells
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Check
from tombo_propeller.design.flight_files import SCENARIO
from tombo_propeller.design.recommend import Recommendation
from tombo_propeller.design.request import QUANTITIES

_HEADINGS = ("margin", "force", "recovery", "noise", "L/D")


def print_design(
    found: Design, made: Recommendation, folder: str | None, written: Sequence[str]
) -> None:
    """Print what was found, and where the files are."""
    out = console(highlight=False)
    style = "bold green" if made.index is not None else "bold red"
    print_line(f"{words.headline(found, made)}.", style)
    asked = ", ".join(limit.text for limit in found.choice.limits)
    mass_kg, arm_mm = found.request.mass_kg, 1e3 * found.request.arm_m
    print_line(f"For {mass_kg:g} kg on arms of {arm_mm:g} mm: {asked}.")
    for text in (*words.reasons(found, made), *words.relief_lines(found)):
        print_line(f"  {text}")
    out.print("", _candidates(found, made), "", sep="\n")
    print_line(
        "* measured; ≤ upper end of a prediction; ? outside of what was tested; others modelled",
        "dim",
    )
    if made.check is not None:
        out.print(_claims(made.check))
    print_line("Not measured:", "bold")
    for text in (*words.caveats(found, made), *words.sources(found)):
        print_line(f"  {text}")
    if folder is not None:
        print_line(f"Written into {folder}: {', '.join(written)}")
        if SCENARIO in written:
            print_line(f"Fly it: {command_line(('fly', f'{folder}/{SCENARIO}'))}")


def _candidates(found: Design, made: Recommendation) -> Table:
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("candidate\n[dim]fibres, from-to mm[/dim]", no_wrap=True)
    for heading, quantity in zip(_HEADINGS, QUANTITIES, strict=True):
        unit = f"\n[dim]{quantity.unit}[/dim]" if quantity.unit else ""
        table.add_column(f"{heading}{unit}", justify="right", no_wrap=True)
    table.add_column("", min_width=15)
    for index, why in table_cells.shown(found, made):
        style = {"recommended": "green", "fails in flight": "red"}.get(why, "")
        figures = (table_cells.cell(found, index, k) for k in range(len(QUANTITIES)))
        table.add_row(
            Text(table_cells.label_of(found, index)), *figures, Text(_brief(why)), style=style
        )
    return table


def _brief(why: str) -> str:
    """Return a remark with the columns' headings for the quantities."""
    for heading, quantity in zip(_HEADINGS, QUANTITIES, strict=True):
        why = why.replace(quantity.words, heading)
    return why.replace("keeps to all limits", "fits").replace(" and ", ", ")


def _claims(check: Check) -> Table:
    title = f"Claimed and simulated, {len(check.seeds)} collisions"
    table = Table("", *right("claimed", "simulated"), "", box=SIMPLE_HEAD, title=title)
    for claim in (*check.claims, *check.limits):
        table.add_row(
            claim.text,
            f"{claim.claimed:.4g} {claim.unit}".rstrip(),
            f"{claim.simulated:.4g} {claim.unit}".rstrip(),
            "[green]held[/green]" if claim.held else "[red]broken[/red]",
        )
    return table

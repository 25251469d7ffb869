"""`tombo propeller reproduce`: everything numeric in the paper, computed again and judged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import Tell
    from tombo_bringup.stop_signals import StopSignals
    from tombo_bringup.workbench.reproduce.reproduction import Reproduction

_COLOURS = {"holds": "green", "fails": "red", "can't be checked": "yellow"}


def reproduce(
    law: Annotated[
        list[str] | None,
        typer.Option(
            "--law",
            help="Compute under this law only: published, repaired or consistent. May be given "
            "several times. Default: all three.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Write reproduction.html, reproduction.json and the figures into this folder, "
            "new or empty.",
        ),
    ] = None,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Replace the results in DIR; other files in it are left alone."
        ),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the list of claims as JSON, and nothing else.")
    ] = False,
) -> None:
    """Recompute what the paper prints, and give each of its claims a verdict.

    Holds, fails or can't be checked, with the evidence. A claim about the paper's model is judged
    by law published, its program with all defects, unless --law leaves that out.
    """
    from tombo_bringup.cli.progress import progress_bar
    from tombo_bringup.stop_signals import Stopped, StopSignals
    from tombo_dynamics.errors import InputError

    if output is not None and not output.strip():
        raise InputError(f"-o '{output}': no name; accepted: a folder, new or empty")
    laws = _checked(law)
    with StopSignals() as stop:
        try:
            with progress_bar() as tell:
                found = _run(laws, None if output is None else Path(output), force, stop, tell)
        except Stopped:
            typer.echo("Error: interrupted", err=True)
            raise typer.Exit(stop.exit_code) from None
    if as_json:
        claims = [claim.mapping() for claim in found.claims]
        typer.echo(json.dumps(claims, indent=1, ensure_ascii=False, allow_nan=False))
    else:
        _print(found)
    if output is not None:
        typer.echo(f"Read {Path(output) / 'reproduction.html'}", err=as_json)


def _run(
    laws: tuple[str, ...], path: Path | None, force: bool, stop: StopSignals, tell: Tell
) -> Reproduction:
    from tombo_bringup.output_folder import open_output

    tell("loading", 0.0)
    if path is None:
        with stop.at_once():
            from tombo_bringup.workbench.reproduce import reproduction

            return reproduction.reproduce(laws)
    from tombo_bringup.workbench.reproduce.output import REPRODUCTION_FILES, write_reproduction

    with open_output(path, replace=force, results=REPRODUCTION_FILES) as folder:
        with stop.at_once():
            from tombo_bringup.workbench.reproduce import reproduction

            tell("computing", 0.0)
            found = reproduction.reproduce(laws)
            write_reproduction(folder, found, tell)
        folder.publish()
    return found


def _checked(given: list[str] | None) -> tuple[str, ...]:
    """Return the laws to compute, in their usual order, each once.

    Raises:
        InputError: unknown law.
    """
    from tombo_dynamics.propeller import LAWS
    from tombo_dynamics.propeller.laws.names import law_number

    chosen = given or list(LAWS)
    for law in chosen:
        law_number(law)
    return tuple(law for law in LAWS if law in chosen)


def _print(found: Reproduction) -> None:
    """Print the outcome, then every claim: verdict, paper beside computed, evidence."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    from tombo_bringup.workbench.reproduce.reproduction import GROUPS
    from tombo_bringup.workbench.reproduce.words import (
        MARKS,
        computed_text,
        headline,
        summary,
        verdict_text,
    )

    console = Console(highlight=False)
    console.print(Text(f"{headline(found)}.", "bold"))
    console.print(Text(summary(found)))
    for group in GROUPS:
        console.print(Text(f"\n{group}", "bold"))
        for claim in found.claims:
            if claim.group == group:
                verdict = f"{MARKS[claim.verdict]} {verdict_text(claim)}: "
                lines = Text.assemble(
                    (verdict, _COLOURS[claim.verdict]),
                    f"{claim.claim} ({claim.source}).\n",
                    f"Paper: {claim.paper}. Computed: {computed_text(claim)}.\n",
                    (claim.evidence, "dim"),
                )
                console.print(Padding(lines, (0, 0, 0, 2), expand=False))

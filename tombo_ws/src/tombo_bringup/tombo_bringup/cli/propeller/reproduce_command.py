"""`tombo propeller reproduce`: everything numeric in the paper, computed again and judged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tombo_bringup.cli.options import Force, json_option, option, output_option
from tombo_bringup.cli.result_files import check_output, compute_into

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_flight.process.output_folder import OutputFolder
    from tombo_propeller.reproduce.reproduction import Reproduction

_COLOURS = {"holds": "green", "fails": "red", "can't be checked": "yellow"}


def reproduce(
    law: Annotated[
        list[str] | None,
        option(
            "--law",
            "Compute under this law only: published, repaired or consistent. May be given "
            "several times. Default: all three.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        output_option(
            "Write reproduction.html, reproduction.json and the figures into this folder, new or "
            "empty."
        ),
    ] = None,
    force: Force = False,
    as_json: Annotated[
        bool, json_option("Print the list of claims as JSON, and nothing else.")
    ] = False,
) -> None:
    """Recompute what the paper prints, and give each of its claims a verdict.

    Holds, fails or can't be checked, with the evidence. A claim about the paper's model is judged
    by law published, its program with all defects, unless --law leaves that out.
    """
    check_output(output)
    laws = _checked(law)
    path = None if output is None else Path(output)
    names: tuple[str, ...] = ()
    if path is not None:
        from tombo_propeller.reproduce.output import REPRODUCTION_FILES

        names = REPRODUCTION_FILES

    def run(on_progress: ProgressCallback) -> Reproduction:
        on_progress("loading", 0.0)
        from tombo_propeller.reproduce import reproduction

        on_progress("computing", 0.0)
        return reproduction.reproduce(laws)

    def write(folder: OutputFolder, found: Reproduction, on_progress: ProgressCallback) -> None:
        from tombo_propeller.reproduce.output import write_reproduction

        write_reproduction(folder, found, on_progress)

    found, _, _ = compute_into(path, force, names, run, write)
    if as_json:
        claims = [claim.mapping() for claim in found.claims]
        typer.echo(json.dumps(claims, indent=1, ensure_ascii=False, allow_nan=False))
    else:
        _print(found)
    if path is not None:
        typer.echo(f"Read {path / 'reproduction.html'}", err=as_json)


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
    from rich.padding import Padding
    from rich.text import Text

    from tombo_bringup.cli.tables import console
    from tombo_propeller.reproduce.reproduction import GROUPS
    from tombo_propeller.reproduce.summary_text import (
        MARKS,
        computed_text,
        headline,
        summary,
        verdict_text,
    )

    out = console(highlight=False)
    out.print(Text(f"{headline(found)}.", "bold"))
    out.print(Text(summary(found)))
    for group in GROUPS:
        out.print(Text(f"\n{group}", "bold"))
        for claim in found.claims:
            if claim.group == group:
                verdict = f"{MARKS[claim.verdict]} {verdict_text(claim)}: "
                lines = Text.assemble(
                    (verdict, _COLOURS[claim.verdict]),
                    f"{claim.claim} ({claim.source}).\n",
                    f"Paper: {claim.paper}. Computed: {computed_text(claim)}.\n",
                    (claim.evidence, "dim"),
                )
                out.print(Padding(lines, (0, 0, 0, 2), expand=False))

"""`tombo propeller reproduce`: everything numeric in the paper, computed again and judged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli.options import Copies, Force, option, record
from tombo_bringup.cli.result_files import Place, compute_into

if TYPE_CHECKING:
    from tombo_flight.progress import ProgressCallback
    from tombo_propeller.reproduce.reproduction import Reproduction


@record
class _Laws:
    law: list[str] | None = option(
        "--law L",
        "Compute under this law only: published, repaired or consistent. May be given several "
        "times. Default: all three.",
    )


def reproduce(given: _Laws, force: Force, copies: Copies) -> None:
    """Recompute what the paper prints, and give each of its claims a verdict.

    Holds, fails or can't be checked, with the evidence. A claim about the paper's model is judged
    by law published, its program with all defects, unless --law leaves that out. With -o also
    reproduction.html, reproduction.json and the figures.
    """
    from tombo_bringup.cli.tables import show_page
    from tombo_propeller.reproduce.page import (
        REPRODUCTION_FILES,
        reproduction_page,
        write_reproduction,
    )

    laws = _checked(given.law)
    place = None if copies.output is None else Place(Path(copies.output), replace=force.force)

    def run(on_progress: ProgressCallback) -> Reproduction:
        on_progress("loading", 0.0)
        from tombo_propeller.reproduce import reproduction

        on_progress("computing", 0.0)
        return reproduction.reproduce(laws)

    result, path, _ = compute_into(place, REPRODUCTION_FILES, run, write_reproduction)
    if copies.as_json:
        claims = [claim.mapping() for claim in result.claims]
        typer.echo(json.dumps(claims, indent=1, ensure_ascii=False, allow_nan=False))
    else:
        show_page(reproduction_page(result), False)
    if path is not None:
        typer.echo(f"Read {path / 'reproduction.html'}", err=copies.as_json)


def _checked(given: list[str] | None) -> tuple[str, ...]:
    """Return the laws to compute, in their usual order, each once.

    Raises:
        InputError: unknown law.
    """
    from tombo_dynamics.propeller import LAWS
    from tombo_dynamics.propeller.laws.parameters import law_number

    chosen = given or list(LAWS)
    for law in chosen:
        law_number(law)
    return tuple(law for law in LAWS if law in chosen)

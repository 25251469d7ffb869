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
        from tombo_propeller.reproduce.page import REPRODUCTION_FILES

        names = REPRODUCTION_FILES

    def run(on_progress: ProgressCallback) -> Reproduction:
        on_progress("loading", 0.0)
        from tombo_propeller.reproduce import reproduction

        on_progress("computing", 0.0)
        return reproduction.reproduce(laws)

    def write(folder: OutputFolder, result: Reproduction, on_progress: ProgressCallback) -> None:
        from tombo_propeller.reproduce.page import write_reproduction

        write_reproduction(folder, result, on_progress)

    result, _, _ = compute_into(path, force, names, run, write)
    if as_json:
        claims = [claim.mapping() for claim in result.claims]
        typer.echo(json.dumps(claims, indent=1, ensure_ascii=False, allow_nan=False))
    else:
        from tombo_bringup.cli.tables import show_page
        from tombo_propeller.reproduce.page import reproduction_page

        show_page(reproduction_page(result), as_json)
    if path is not None:
        typer.echo(f"Read {path / 'reproduction.html'}", err=as_json)


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

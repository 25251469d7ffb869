"""`tombo diagnose --explain-mapping`: a mapping file for a log that nobody has described yet."""

from __future__ import annotations

from pathlib import Path

import typer

from tombo_bringup.cli.result_files import check_output, write_file
from tombo_dynamics.errors import InputError


def print_proposal(logs: list[Path], output: str | None, force: bool) -> None:
    """Print a mapping file, or write it to a file, which is replaced only with `force`.

    Raises:
        InputError: more than one log, one that can't be used, or a file that is there.
    """
    if len(logs) > 1:
        raise InputError(f"--explain-mapping: {len(logs)} logs; accepted: one")
    check_output(output)
    path = None if output is None else Path(output)
    if path is not None and (path.is_dir() or (path.exists() and not force)):
        what = "a folder" if path.is_dir() else "there already"
        raise InputError(f"-o '{path}' is {what}; accepted: a new file, or --force to replace one")
    from tombo_flight.command_line import command_line
    from tombo_logs.proposal.explain import explain_mapping

    text = explain_mapping(logs[0])
    if path is None:
        typer.echo(text, nl=False)
        return
    write_file(path, text)
    again = command_line(("diagnose", str(logs[0])), [("--mapping", str(path))])
    typer.echo(f"Wrote {path}; diagnose with: {again}")

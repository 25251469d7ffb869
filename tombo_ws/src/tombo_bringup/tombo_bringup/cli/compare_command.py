"""`tombo compare`: two recordings, topic by topic."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import typer

from tombo_bringup.cli.options import Copies, argument, command, option, record
from tombo_bringup.cli.result_files import Place, compute_into
from tombo_bringup.cli.tables import show_page

app = typer.Typer()

COMPARE_EXIT_CODES = "Exit code: 0 when nothing differs, 1 when something does, 2 for bad input."
FILE = "compare.json"


@record
class _Recordings:
    recordings: tuple[str, str] = argument(
        "A B", "Two of: MCAP file, bag folder, a flight's results folder."
    )
    topics: list[str] | None = option(
        "--topic T",
        "Compare this topic only. May be given many times. Default: all but those about the "
        "processes (/clock, /diagnostics, /events/write_split, /parameter_events, /rosout).",
    )


@command(app, epilog=COMPARE_EXIT_CODES)
def compare(given: _Recordings, copies: Copies) -> None:
    """Compare two recordings topic by topic: every message, every field, to the last bit.

    With --topic each field that differs is listed, too. Messages are paired by the stamp of their
    header, without one by publish time. Times of receipt are not compared; NaN equals NaN. With
    -o also compare.json, over that of an earlier one.
    """
    from tombo_bag.comparison import compare_recordings
    from tombo_flight.json_text import as_json as to_json

    a, b = given.recordings
    found, folder, _ = compute_into(
        None if copies.output is None else Place(Path(copies.output), replace=True),
        (FILE,),
        lambda on_progress: compare_recordings(a, b, given.topics or ()),
        lambda folder, found, _: (folder / FILE).write_text(
            to_json(asdict(found)["topics"]), encoding="utf-8", newline="\n"
        ),
    )
    for line in found.damage:
        typer.echo(f"Damage: {line}", err=True)
    if copies.as_json:
        typer.echo(to_json(asdict(found)["topics"]), nl=False)
    else:
        from tombo_flight.report.comparison import comparison_page

        page = comparison_page(found, a, b, fields=bool(given.topics))
        show_page(page, False, folder, (FILE,))
    raise typer.Exit(0 if found.equal else 1)

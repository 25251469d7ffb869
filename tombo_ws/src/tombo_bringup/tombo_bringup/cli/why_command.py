"""`tombo why`: why one flight went wrong, from its log alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli.options import Logs, Reading, Results, command
from tombo_bringup.cli.result_files import publish
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_diagnosis.crash.reason import Why
    from tombo_flight.process.output_folder import OutputFolder

app = typer.Typer()
WHY_FILES = ("why.json", "report.html")


@command(
    app,
    epilog="Exit code: 0 whatever the answer; 2 for bad input or output that can't be written; "
    "130 after Ctrl-C.",
)
def why(logs: Logs, reading: Reading, results: Results) -> None:
    """Say when a flight first went wrong, why, and what shows it.

    From one log of a crash or a bad flight, and no other: the first deviation, the most probable
    cause of it, and the signs before and after as a time line.
    """
    from tombo_diagnosis.report.why_page import why_page

    if len(logs.logs) > 1:
        raise InputError(f"{len(logs.logs)} logs; accepted: one")
    (log,), names = logs.logs, reading.names
    publish(
        results,
        f"why-{log.name.split('.')[0]}",
        WHY_FILES,
        lambda on_progress: run(log, reading.mapping, names, on_progress),
        lambda folder, found, on_progress: write(folder, found),
        lambda found, folder: why_page(found),
    )


def write(folder: OutputFolder, found: Why) -> None:
    """Write the files of an answer into an output folder, which the caller publishes."""
    from tombo_diagnosis.report.why_page import why_page
    from tombo_flight.report.html import write_page
    from tombo_flight.report.page import page_json

    page = why_page(found)
    (folder / WHY_FILES[0]).write_text(page_json(page), encoding="utf-8", newline="\n")
    write_page(folder / WHY_FILES[1], page)


def run(
    log: Path, mapping: str | None, names: dict[str, str], on_progress: ProgressCallback
) -> Why:
    """Read a log and say why it went wrong.

    Raises:
        InputError: the log or the mapping can't be used, or it is a folder of several.
    """
    on_progress(f"reading {log.name}", 0.0)
    from tombo_diagnosis.crash.reason import why as why_of
    from tombo_logs.readers.log_reader import read_single_log

    flight = read_single_log(log, mapping, names)
    on_progress("looking for what went wrong", 0.5)
    return why_of(flight)

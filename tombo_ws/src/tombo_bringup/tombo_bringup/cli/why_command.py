"""`tombo why`: why one flight went wrong, from its log alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli.options import Logs, Reading, Results, command
from tombo_bringup.cli.result_files import publish
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_diagnosis.crash.reason import Why
    from tombo_flight.progress import ProgressCallback

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
    (log,) = logs.logs

    def compute(on_progress: ProgressCallback) -> Why:
        on_progress(f"reading {log.name}", 0.0)
        from tombo_diagnosis.crash.reason import why as why_of
        from tombo_logs.readers.log_reader import read_single_log

        flight = read_single_log(log, reading.mapping, reading.names)
        on_progress("looking for what went wrong", 0.5)
        return why_of(flight)

    name = f"why-{log.name.split('.')[0]}"
    publish(results, name, WHY_FILES, compute, lambda found, folder: why_page(found))

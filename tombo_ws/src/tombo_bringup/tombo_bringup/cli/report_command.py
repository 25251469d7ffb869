"""`tombo report`: the page of any logs, own or foreign, up to six in the same plots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli.options import Logs, Reading, Results, command
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bag.flight import Flight
    from tombo_diagnosis.crash.reason import Why
    from tombo_flight.progress import ProgressCallback
    from tombo_flight.report.page import Page

app = typer.Typer()

PAGE = "report.html"
NAMELESS = "recording"
"""Name of a flight whose recording says none."""


@command(
    app,
    epilog="Exit code: 0 when the page is made, whatever it says; 2 for bad input or output that "
    "can't be written; 130 after Ctrl-C.",
)
def report(logs: Logs, reading: Reading, results: Results) -> None:
    """Show what was asked for and flown, vibration, rotors, battery, motion capture, events.

    Set points against estimates, spectra, saturation, health of the motion capture and a first
    diagnosis; logs side by side are drawn in the same plots, each from its own beginning.
    """
    from tombo_bringup.cli.result_files import publish
    from tombo_diagnosis.report.log_page import MOST_LOGS, log_page

    if len(logs.logs) > MOST_LOGS:
        raise InputError(f"{len(logs.logs)} logs; accepted: 1 to {MOST_LOGS}")

    def compute(on_progress: ProgressCallback) -> Page:
        on_progress("reading", 0.0)
        flights = read(logs.logs, reading.mapping, reading.names)
        return log_page(flights, [reason(flight) for flight in flights])

    name = f"report-{logs.logs[0].name.split('.')[0]}"
    publish(results, name, [PAGE], compute, lambda page, folder: page)


def read(logs: list[Path], mapping: str | None, names: dict[str, str]) -> list[Flight]:
    """Read logs and check them; a log that they refuse is shown as it is.

    Raises:
        InputError: a log or the mapping can't be used.
    """
    from dataclasses import replace

    from tombo_logs.checks import findings_of
    from tombo_logs.readers.log_reader import read_every_topic

    flights: list[Flight] = []
    sources = []
    for path in logs:
        for flight in read_every_topic(path, mapping, names):
            flights.append(replace(flight, findings=findings_of(flight)))
            sources.append(path.absolute())
    called = different_names([flight.name for flight in flights], sources)
    return [replace(flight, name=name) for flight, name in zip(flights, called, strict=True)]


def different_names(names: list[str], sources: list[Path]) -> list[str]:
    """Return the names of flights, or where these don't tell them apart those of their files."""
    stems = [path.stem for path in sources]
    folders = [f"{path.parent.name}/{path.stem}" for path in sources]
    for called in (names, stems, folders):
        if len(set(called)) == len(called) and not {"", NAMELESS} & set(called):
            return called
    return [f"{number} {name}" for number, name in enumerate(folders, 1)]


def reason(flight: Flight) -> Why | InputError:
    """Return why a flight went wrong, or what forbids to say it."""
    from tombo_diagnosis.crash.reason import why

    try:
        return why(flight)
    except InputError as error:
        return error

"""`tombo diagnose NEW... --healthy OLD...`: what has changed on a vehicle."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Column, Table

from tombo_bringup.cli.result_files import compute_into, results_folder
from tombo_bringup.cli.tables import console, print_line, right
from tombo_diagnosis.wording import certainty, interval, unit

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_diagnosis.change.diagnose import ChangeData
    from tombo_diagnosis.diagnosis import Diagnosis


def say_what_changed(
    new: list[Path],
    healthy: list[Path],
    mapping: str | None,
    names: dict[str, str],
    output: str | None,
    force: bool,
    no_report: bool,
    as_json: bool,
) -> None:
    """Compare, write and print; arguments as of `tombo diagnose`.

    Raises:
        InputError: a log or the mapping can't be used.
    """
    from tombo_diagnosis.report.change_report import CHANGE_FILES, write_change
    from tombo_diagnosis.report.diagnosis_output import diagnosis_json

    path = results_folder(output, "diagnosis", new[0].name.split(".")[0], as_json, "log")
    (found, _), path, written = compute_into(
        path, force, CHANGE_FILES,
        lambda on_progress: run_change(new, healthy, mapping, names, on_progress),
        lambda folder, both, on_progress: write_change(
            folder, *both, pictures=not no_report, on_progress=on_progress
        ),
        numbered=output is None,
    )  # fmt: skip
    if as_json:
        typer.echo(diagnosis_json(found), nl=False)
    else:
        print_change(found, path, written)


def run_change(
    new: list[Path],
    healthy: list[Path],
    mapping: str | None,
    names: dict[str, str],
    on_progress: ProgressCallback,
) -> tuple[Diagnosis, ChangeData]:
    """Read the flights, all of them once, check, and compare.

    Raises:
        InputError: a log or the mapping can't be used, no flight of one side can, or a flight is
            on both sides.
    """
    from tombo_logs.readers.log_reader import logs_in, read_logs

    on_progress(f"reading {new[0].name} and others", 0.0)
    count = sum(len(logs_in(path)) for path in new)
    flights = read_logs([*new, *healthy], mapping=mapping, names=names)

    on_progress("loading the model", 0.5)  # imports compiled code
    from tombo_diagnosis.change.diagnose import NEEDED, diagnose_change
    from tombo_diagnosis.flight.diagnose import check_flights
    from tombo_diagnosis.flight.scenario_nominal import nominal_model

    nominal = nominal_model()
    (after, faults), (before, more) = (
        check_flights(side, needed=NEEDED, progress=on_progress)
        for side in (flights[:count], flights[count:])
    )
    on_progress("comparing", 0.9)
    return diagnose_change(after, before, nominal, time.perf_counter, [*faults, *more])


def print_change(found: Diagnosis, folder: Path | None, written: list[str]) -> None:
    """Print what has changed, and where the files are."""
    from tombo_bringup.cli.diagnosis.diagnosis_tables import print_findings
    from tombo_diagnosis.change.summary_text import headline, phrase
    from tombo_diagnosis.report.change_report import change_labels

    colour = {"none": "bold green", "unknown": "bold red"}.get(found.verdict, "bold yellow")
    labels = change_labels(found)
    print_findings(found.prechecks, "fault")  # a fault of a log may be all that has changed
    print_line(f"{headline(found.verdict, labels)}.", colour)
    print_line(f"({found.verdict}, {certainty(found.confidence)}) {found.summary}")
    if found.changed:
        columns = (Column("it may be"), *right("sure"), Column("parameter"), *right("value"))
        table = Table(*columns, "95 % interval", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        for label, change in zip(labels, found.changed, strict=True):
            for theta in change.theta:
                value, low, high = interval(theta)
                size = f"{value} {unit(theta.unit)}".strip()
                cells = (phrase(label), certainty(change.confidence), theta.name, size)
                table.add_row(*cells, f"{low} to {high}")
            if not change.theta:
                table.add_row(phrase(label), certainty(change.confidence), "", "", "")
        console(highlight=False).print(table)
    print_findings(found.prechecks, "warning")
    for note in found.notes:
        print_line(f"Note: {note}")
    if folder is not None:
        print_line(f"Wrote {', '.join(written)} to {folder}")

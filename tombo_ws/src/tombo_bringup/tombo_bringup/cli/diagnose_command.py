"""`tombo diagnose`: errors of the simulation in measured flights, and their causes."""

from __future__ import annotations

import datetime
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import command, option, record
from tombo_bringup.cli.result_files import check_new_file, publish
from tombo_dynamics.errors import InputError
from tombo_flight.progress import ProgressCallback

if TYPE_CHECKING:
    from tombo_diagnosis.change.diagnose import ChangeData
    from tombo_diagnosis.diagnosis import Diagnosis
    from tombo_diagnosis.report.files import NominalReference

app = typer.Typer()
_MANY: Final = "--healthy"
DIAGNOSE_EXIT_CODES: Final = (
    "Exit code: 0 whatever the verdict; 2 for bad input or output that can't be written; 130 "
    "after Ctrl-C, 143 after SIGTERM, with nothing written."
)


def spread_paths(args: list[str]) -> list[str]:
    """Return `--healthy A B --json` as `--healthy A --healthy B --json`: it takes all paths."""
    spread: list[str] = []
    taking = first = False
    for k, arg in enumerate(args):
        if arg == "--":
            return [*spread, *args[k:]]
        if taking and not arg.startswith("-"):
            spread += [arg] if first else [_MANY, arg]
            first = False
            continue
        taking = first = arg == _MANY
        spread.append(arg)
    return spread


@record
class _Diagnosed(options.Logs):
    explain: bool = option(
        "--explain-mapping",
        "Propose a mapping file for one log and leave: YAML with a reason for each line, on "
        "standard output or in the file of -o.",
        False,
    )
    healthy: list[Path] | None = option(
        "--healthy OLD...",
        "Flights of the same vehicle from before: say what has changed since. They are the model; "
        "no other is used. All paths up to the next option, or once for each.",
    )
    sessions: list[str] | None = option(
        "--session NAME=PATTERN",
        "With --healthy: flights whose names fit the pattern are of this session, as "
        "monday='normal_[123]'. Default: their dates; without dates, demand that is alike.",
    )
    no_report: bool = option("--no-report", "Write no report.html.", False)


@command(app, lab=True, epilog=DIAGNOSE_EXIT_CODES, expand=spread_paths)
def diagnose(
    given: _Diagnosed,
    known: options.VehicleName,
    model: options.ModelFile,
    imports: options.Imports,
    reading: options.Reading,
    results: options.Results,
) -> None:
    """Say what the simulation gets wrong in measured flights, name the cause, measure the gain.

    Writes report.html and diagnosis.json; model.yaml, the extended model, where a cause is
    named (`tombo fly --model`).
    """
    # One thread of linear algebra: on matrices this small more get into each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    logs = given.logs
    if given.explain:
        _explain_mapping(logs, results.output, results.force)
        return
    names = reading.names
    name, pictures = f"diagnosis-{logs[0].name.split('.')[0]}", not given.no_report
    if given.healthy is not None:
        if model.model is not None:
            raise InputError("--model and --healthy: both say what to compare with; accepted: one")
        from tombo_diagnosis.report.change_page import change_page
        from tombo_diagnosis.report.files import REPORT_FILES, write_report

        sessions = _sessions(given.sessions or [])
        healthy = given.healthy

        def compare(on_progress: ProgressCallback) -> tuple[Diagnosis, ChangeData]:
            from tombo_logs.readers.log_reader import logs_in, read_logs

            on_progress(f"reading {logs[0].name} and others", 0.0)
            count = sum(len(logs_in(path)) for path in logs)
            flights = read_logs([*logs, *healthy], mapping=reading.mapping, names=names)
            on_progress("loading the model", 0.5)
            from tombo_diagnosis.change.diagnose import diagnose_change_unchecked

            new, before = flights[:count], flights[count:]
            return diagnose_change_unchecked(new, before, time.perf_counter, sessions, on_progress)

        publish(
            results,
            name,
            REPORT_FILES,
            compare,
            lambda both, folder: change_page(*both),
            lambda folder, both, _: write_report(folder, change_page(*both), pictures=pictures),
        )
        return
    if given.sessions:
        raise InputError(f"--session {given.sessions[0]}: accepted with --healthy OLD... only")
    from tombo_diagnosis.report.files import DIAGNOSIS_FILES, write_diagnosis
    from tombo_diagnosis.report.page import diagnosis_page

    file, vehicle = None if model.model is None else Path(model.model), known.vehicle
    publish(
        results,
        name,
        DIAGNOSIS_FILES,
        lambda on_progress: run(logs, file, reading.mapping, names, on_progress, vehicle),
        lambda both, folder: diagnosis_page(both[0], str(folder or ""), vehicle or ""),
        lambda folder, both, on_progress: write_diagnosis(
            folder, *both, pictures=pictures, on_progress=on_progress
        ),
    )


def run(
    logs: list[Path],
    model: Path | None,
    mapping: str | None,
    names: dict[str, str],
    on_progress: ProgressCallback,
    vehicle: str | None = None,
) -> tuple[Diagnosis, NominalReference]:
    """Read, check and diagnose.

    Raises:
        InputError: a log, the mapping, the vehicle or the model can't be used.
    """
    from tombo_diagnosis.report.files import NominalReference

    on_progress("loading the model", 0.0)  # imports compiled code
    from tombo_diagnosis.flight.diagnose import diagnose_logs

    diagnosis, label, base = diagnose_logs(
        logs, model, mapping, names, vehicle, time.perf_counter, on_progress
    )
    today = datetime.date.today().isoformat()
    return diagnosis, NominalReference(label, today, base, vehicle or "")


def _sessions(given: list[str]) -> dict[str, str]:
    """Return pattern -> session of `--session NAME=PATTERN`.

    Raises:
        InputError: it has no name or no pattern.
    """
    sessions = {}
    for text in given:
        name, _, pattern = text.partition("=")
        if not name or not pattern:
            raise InputError(f"--session {text}: accepted: NAME=PATTERN, as monday=normal_[123]")
        sessions[pattern] = name
    return sessions


def _explain_mapping(logs: list[Path], output: str | None, force: bool) -> None:
    """Print a mapping file for a log that nobody has described yet, or write it to a file.

    Raises:
        InputError: more than one log, one that can't be used, or a file that exists and may not
            be replaced.
    """
    if len(logs) > 1:
        raise InputError(f"--explain-mapping: {len(logs)} logs; accepted: one")
    path = None if output is None else Path(output)
    if path is not None:
        check_new_file(path, force)
    from tombo_flight.command_line import command_line
    from tombo_flight.process.output_folder import write_whole
    from tombo_logs.proposal.explain import explain_mapping

    text = explain_mapping(logs[0])
    if path is None:
        typer.echo(text, nl=False)
        return
    write_whole(path, text)
    again = command_line(("diagnose", str(logs[0])), [("--mapping", str(path))])
    typer.echo(f"Wrote {path}; diagnose with: {again}")

"""`tombo diagnose`: what the simulation gets wrong in measured flights, and why."""

from __future__ import annotations

import datetime
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tombo_bringup.cli.diagnosis.many_paths import ManyPathsCommand
from tombo_bringup.cli.options import (
    Force,
    TopicNames,
    UnpackLimit,
    former_option,
    json_option,
    option,
    output_option,
    topic_names,
)
from tombo_bringup.cli.result_files import compute_into, results_folder
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_diagnosis.diagnosis import Diagnosis
    from tombo_diagnosis.report.diagnosis_output import NominalReference

app = typer.Typer()

DIAGNOSE_EXIT_CODES = (
    "Exit code: 0 whatever the verdict; 2 for bad input or output that can't be written; 130 "
    "after Ctrl-C, 143 after SIGTERM, with nothing written."
)


@app.command(epilog=DIAGNOSE_EXIT_CODES, cls=ManyPathsCommand)
def diagnose(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Flights of one vehicle: MCAP, rosbag2 folder, ROS 1 bag, PX4 ULog, CSV.",
            show_default=False,
        ),
    ],
    model: Annotated[
        Path | None,
        option(
            "--model FILE",
            "Hold the flights against this model, as written by an earlier diagnosis. Default: "
            "the suite's own.",
        ),
    ] = None,
    vehicle: Annotated[
        str | None,
        option(
            "--vehicle NAME|FILE",
            "The vehicle that flew: a name of `tombo vehicle list`, or a vehicle file; its "
            "tolerances say what is no finding. Default: the suite's own.",
        ),
    ] = None,
    mapping: Annotated[
        str | None,
        option(
            "--mapping FILE|NAME",
            "What the columns of a CSV are, in which units and frames (docs/logs.md).",
        ),
    ] = None,
    explain: Annotated[
        bool,
        option(
            "--explain-mapping",
            "Propose a mapping file for one log and leave: YAML with a reason for each line, on "
            "standard output or in the file of -o.",
        ),
    ] = False,
    healthy: Annotated[
        list[Path] | None,
        option(
            "--healthy OLD...",
            "Flights of the same vehicle from before: say what has changed since. They are the "
            "model; no other is used. All paths up to the next option, or once for each.",
        ),
    ] = None,
    maps: TopicNames = None,
    topics: Annotated[list[str] | None, former_option("--topic TOPIC=NAME", "--map")] = None,
    output: Annotated[
        str | None,
        output_option(
            "Folder of the results, new or empty. Default: runs/diagnosis-LOG, numbered; with "
            "--json nothing is written."
        ),
    ] = None,
    force: Force = False,
    no_report: Annotated[
        bool, option("--no-report", "Write no report.html and no plots.")
    ] = False,
    unpack_limit: UnpackLimit = None,
    as_json: Annotated[bool, json_option("Print diagnosis.json, and nothing else.")] = False,
) -> None:
    """Say what the simulation gets wrong in measured flights, name the cause, measure the gain.

    Writes report.html, diagnosis.json and plots; model.yaml, the extended model,
    where a cause is named (`tombo fly --model`); separating_experiment.yaml, the
    mission to fly, where causes can't be distinguished.
    """
    # One thread of linear algebra: on matrices this small more get into each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if explain:
        from tombo_bringup.cli.diagnosis.mapping_proposal import print_proposal

        print_proposal(logs, output, force)
        return
    from tombo_diagnosis.report.diagnosis_output import (
        DIAGNOSIS_FILES,
        diagnosis_json,
        write_diagnosis,
    )

    names = topic_names("--map", [*(maps or []), *(topics or [])])
    if healthy is not None:
        if model is not None:
            raise InputError("--model and --healthy: both say what to compare with; accepted: one")
        from tombo_bringup.cli.diagnosis.change_command import say_what_changed

        say_what_changed(logs, healthy, mapping, names, output, force, no_report, as_json)
        return
    path = results_folder(output, "diagnosis", logs[0].name.split(".")[0], as_json, "log")
    (found, _), path, written = compute_into(
        path, force, DIAGNOSIS_FILES,
        lambda on_progress: run(logs, model, mapping, names, on_progress, vehicle),
        lambda folder, both, on_progress: write_diagnosis(
            folder, *both, pictures=not no_report, on_progress=on_progress
        ),
        numbered=output is None,
    )  # fmt: skip
    if as_json:
        typer.echo(diagnosis_json(found), nl=False)
    else:
        from tombo_bringup.cli.diagnosis.diagnosis_tables import print_diagnosis

        print_diagnosis(found, path, written, vehicle or "")


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
    from tombo_diagnosis.report.diagnosis_output import NominalReference

    on_progress("loading the model", 0.0)  # imports compiled code
    from tombo_diagnosis.flight.diagnose import diagnose_logs

    found, label, base = diagnose_logs(
        logs, model, mapping, names, vehicle, time.perf_counter, on_progress
    )
    today = datetime.date.today().isoformat()
    return found, NominalReference(label, today, base, vehicle or "")

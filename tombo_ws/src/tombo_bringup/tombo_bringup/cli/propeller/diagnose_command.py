"""`tombo propeller diagnose`: what the propeller model gets wrong on a thrust stand, and why."""

from __future__ import annotations

import datetime
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tombo_bringup.cli.options import (
    Force,
    UnpackLimit,
    integer_option,
    json_option,
    option,
    output_option,
)
from tombo_bringup.cli.result_files import compute_into, results_folder
from tombo_bringup.cli.tables import show_page

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.table3 import Table3

_CONF, _LAW = 13, "repaired"


def diagnose(
    tables: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[STAND.csv...]",
            help="Runs on a thrust stand, of one propeller or several.",
            show_default=False,
        ),
    ] = None,
    mapping: Annotated[
        str | None,
        option(
            "--mapping FILE|NAME",
            "What the columns are, and in which units (docs/stand.md). Default: recognised.",
        ),
    ] = None,
    conf: Annotated[
        int | None,
        integer_option(
            "--conf N",
            "Configuration of runs that have no column conf; 0 is rigid. Default: 13.",
            show_default=False,
        ),
    ] = None,
    law: Annotated[
        str | None,
        typer.Option(
            "--law",
            help="published, repaired or consistent. Default: repaired.",
            show_default=False,
        ),
    ] = None,
    plain: Annotated[
        bool, option("--plain", "Any other propeller: hold it against T = k omega^2.")
    ] = False,
    table3: Annotated[bool, option("--table3", "Diagnose the paper's own Table III.")] = False,
    model: Annotated[
        Path | None, option("--model FILE", "A stand_model.yaml found earlier.")
    ] = None,
    output: Annotated[
        str | None,
        output_option(
            "Folder of the results, new or empty. Default: runs/stand-NAME, numbered; with "
            "--json nothing is written."
        ),
    ] = None,
    force: Force = False,
    unpack_limit: UnpackLimit = None,
    as_json: Annotated[bool, json_option("Print diagnosis.json, and nothing else.")] = False,
) -> None:
    """Say what the propeller model gets wrong in thrust-stand data, name the cause, or the set.

    Writes report.html, diagnosis.json, plots, and stand_model.yaml where a cause is named.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_diagnosis.report.stand_page import STAND_FILES, stand_page, write_stand
    from tombo_dynamics.errors import InputError

    paths = tables or []
    if bool(paths) == table3:
        named = "both" if table3 else "neither"
        raise InputError(f"STAND.csv or --table3: {named}; accepted: one of them")
    _refuse_without_effect(table3, plain, conf, law, mapping)
    first = "table3" if table3 else paths[0].name.split(".")[0]
    path = results_folder(output, "stand", first, as_json, "run")
    both, path, written = compute_into(
        path, force, STAND_FILES,
        lambda on_progress: run(paths, mapping, conf, law, plain, model, on_progress),
        lambda folder, both, _: write_stand(folder, *both, datetime.date.today().isoformat()),
        numbered=output is None,
    )  # fmt: skip
    show_page(stand_page(*both), as_json, None if as_json else path, written)


def run(
    paths: list[Path],
    mapping: str | None,
    conf: int | None,
    law: str | None,
    plain: bool,
    model: Path | None,
    on_progress: ProgressCallback,
) -> tuple[StandDiagnosis, Table3 | None]:
    """Read and diagnose; of no path, Table III.

    Raises:
        InputError: a table, the mapping, the model, the configuration or the law can't be used.
    """
    from tombo_diagnosis.stand.diagnose import StandDiagnosis, diagnose_points, diagnose_stand
    from tombo_diagnosis.stand.model_file import read_stand_model
    from tombo_diagnosis.stand.table3 import study_table3, table3_assembled
    from tombo_diagnosis.stand.tables.table_reader import read_stand
    from tombo_dynamics.propeller import configuration, parameter_row

    number = _CONF if conf is None else conf
    formulas = _LAW if law is None else law
    parameter_row(configuration(number), formulas)
    given = None if model is None else read_stand_model(model)
    if not paths:
        base = None if given is None else given.theta
        diagnosis, findings = diagnose_points(
            table3_assembled(formulas), (), on_progress, base=base
        )
        on_progress("leaving one configuration out", 0.9)
        return StandDiagnosis(diagnosis, findings, None, given), study_table3(formulas)
    read = []
    for k, path in enumerate(paths):
        on_progress(f"reading {path.name}", k / len(paths))
        read.append(read_stand(path, mapping))
    if all(t.mapping.model == "plain" for t in read):
        _refuse_without_effect(False, True, conf, law, None, "a plain propeller (--mapping)")
    return diagnose_stand(
        read, number, formulas, plain, on_progress, time.perf_counter, given
    ), None


def _refuse_without_effect(
    table3: bool,
    plain: bool,
    conf: int | None,
    law: str | None,
    mapping: str | None,
    of_plain: str = "--plain",
) -> None:
    """Refuse options that would change nothing.

    Raises:
        InputError: there is one.
    """
    from tombo_dynamics.errors import InputError

    by_table3 = {"--plain": plain, "--conf": conf is not None, "--mapping": mapping is not None}
    by_plain = {"--conf": conf is not None, "--law": law is not None}
    for given, options in (("--table3", by_table3), (of_plain, by_plain)):
        idle = [option for option, there in options.items() if there]
        if idle and (table3 if given == "--table3" else plain):
            raise InputError(
                f"{' and '.join(idle)} has no effect with {given}; accepted: one of them"
            )

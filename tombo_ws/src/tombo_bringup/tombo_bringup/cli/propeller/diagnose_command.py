"""`tombo propeller diagnose`: what the propeller model gets wrong on a thrust stand, and why."""

from __future__ import annotations

import datetime
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from tombo_bringup.cli import options
from tombo_bringup.cli.options import argument, option, record
from tombo_bringup.cli.result_files import publish

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.table3 import Table3

_CONF, _LAW = 13, "repaired"
_RULES = (
    options.OptionRule("--table3", "table3", (), ("tables", "plain", "conf", "mapping")),
    options.OptionRule("--plain", "plain", (), ("conf", "law")),
)


@record
class _Stand:
    tables: list[Path] | None = argument(
        "[STAND.csv...]", "Runs on a thrust stand, of one propeller or several.", None
    )
    plain: bool = option("--plain", "Any other propeller: hold it against T = k omega^2.", False)
    table3: bool = option("--table3", "Diagnose the paper's own Table III.", False)


def diagnose(
    given: _Stand,
    reading: options.LogMapping,
    propeller: options.Propeller,
    model: options.ModelFile,
    unpacking: options.Unpacking,
    results: options.Results,
) -> None:
    """Say what the propeller model gets wrong in thrust-stand data, name the cause, or the set.

    Writes report.html, diagnosis.json, plots, and stand_model.yaml where a cause is named, which
    --model takes. Runs that have no column conf are of configuration 13, law repaired.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_diagnosis.report.stand_page import STAND_FILES, stand_page, write_stand
    from tombo_dynamics.errors import InputError

    paths = given.tables or []
    if not paths and not given.table3:
        raise InputError("STAND.csv or --table3: neither; accepted: one of them")
    options.check_options(_RULES, given, propeller, reading)
    publish(
        results,
        f"stand-{'table3' if given.table3 else paths[0].name.split('.')[0]}",
        STAND_FILES,
        lambda on_progress: run(given, reading.mapping, propeller, model.model, on_progress),
        lambda folder, both, _: write_stand(folder, *both, datetime.date.today().isoformat()),
        lambda both, folder: stand_page(*both),
    )


def run(
    stand: _Stand,
    mapping: str | None,
    propeller: options.Propeller,
    model: str | None,
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

    paths = stand.tables or []
    number = _CONF if propeller.conf is None else propeller.conf
    formulas = _LAW if propeller.law is None else propeller.law
    parameter_row(configuration(number), formulas)
    given = None if model is None else read_stand_model(Path(model))
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
        options.check_options(_RULES, propeller, plain=True, table3=False)
    return diagnose_stand(
        read, number, formulas, stand.plain, on_progress, time.perf_counter, given
    ), None

"""`tombo propeller diagnose`: errors of the propeller model on a stand, and their causes."""

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
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_flight.progress import ProgressCallback

_CONF, _LAW = 13, "repaired"
_RULES: tuple[options.Rule, ...] = (("plain", (), ("conf", "law")),)


@record
class _Stand:
    tables: list[Path] = argument(
        "STAND.csv...", "Runs on a thrust stand, of one propeller or several."
    )
    plain: bool = option("--plain", "Any other propeller: hold it against T = k omega^2.", False)


def diagnose(
    given: _Stand,
    reading: options.LogMapping,
    propeller: options.Propeller,
    model: options.ModelFile,
    results: options.Results,
) -> None:
    """Say what the propeller model gets wrong in thrust-stand data, name the cause, or the set.

    Writes report.html, diagnosis.json, and stand_model.yaml where a cause is named, which --model
    takes. Runs that have no column conf are of configuration 13, law repaired.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_diagnosis.report.stand_page import STAND_FILES, stand_page, write_stand

    options.check_options(_RULES, {**vars(given), **vars(propeller)})

    def compute(on_progress: ProgressCallback) -> StandDiagnosis:
        from tombo_diagnosis.stand.diagnose import diagnose_stand
        from tombo_diagnosis.stand.tables.table_reader import read_stand
        from tombo_dynamics.propeller import configuration, parameter_row
        from tombo_dynamics.propeller.effects import STAND_EFFECTS
        from tombo_flight.extended_model import read_model

        number = _CONF if propeller.conf is None else propeller.conf
        formulas = _LAW if propeller.law is None else propeller.law
        parameter_row(configuration(number), formulas)
        known = None if model.model is None else read_model(Path(model.model), STAND_EFFECTS)
        read = []
        for k, path in enumerate(given.tables):
            on_progress(f"reading {path.name}", k / len(given.tables))
            read.append(read_stand(path, reading.mapping))
        if all(t.mapping.model == "plain" for t in read):
            options.check_options(_RULES, {**vars(propeller), "plain": True})
        return diagnose_stand(
            read, number, formulas, given.plain, on_progress, time.perf_counter, known
        )

    publish(
        results,
        f"stand-{given.tables[0].name.split('.')[0]}",
        STAND_FILES,
        compute,
        lambda stand, folder: stand_page(stand),
        lambda folder, stand, _: write_stand(folder, stand, datetime.date.today().isoformat()),
    )

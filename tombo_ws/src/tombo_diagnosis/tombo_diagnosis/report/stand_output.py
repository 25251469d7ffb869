"""The files of a stand diagnosis: the page, JSON, the extended model, plots."""

from __future__ import annotations

import dataclasses
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Final

from tombo_diagnosis.report.diagnosis_output import diagnosis_mapping
from tombo_diagnosis.stand.model_file import extends_model, stand_model_text
from tombo_diagnosis.stand.table3 import statement
from tombo_flight.json_text import as_json, plain
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.table3 import Table3
    from tombo_flight.process.output_folder import OutputFolder

JSON: Final = "diagnosis.json"
MODEL: Final = "stand_model.yaml"
REPORT: Final = "report.html"
RESIDUALS, STIFFNESS, TABLE3 = "plots/residuals.png", "plots/stiffness.png", "plots/table3.png"
STAND_FILES: Final = (REPORT, JSON, MODEL, RESIDUALS, STIFFNESS, TABLE3)
"""All names that a stand diagnosis may write."""


def stand_mapping(found: StandDiagnosis, study: Table3 | None = None) -> dict[str, Any]:
    """Return the content of `diagnosis.json`: that of flights, `runs` for their `flights`."""
    mapping = diagnosis_mapping(found.diagnosis)
    mapping["runs"] = mapping.pop("flights")
    mapping.pop("vehicle")
    if found.constant is not None:
        mapping["thrust_constant"] = plain(dataclasses.asdict(found.constant))
    if study is not None:
        mapping["table3"] = plain(dataclasses.asdict(study)) | {"statement": statement(study)}
    return mapping


def stand_json(found: StandDiagnosis, study: Table3 | None = None) -> str:
    """Return the text of `diagnosis.json`."""
    return as_json(stand_mapping(found, study))


def write_stand(
    folder: OutputFolder, found: StandDiagnosis, study: Table3 | None, headline: str, date: str
) -> None:
    """Write the files of a stand diagnosis into an output folder, which the caller publishes.

    Raises:
        OSError: the files can't be written.
    """
    from tombo_diagnosis.report.stand_page import stand_html
    from tombo_diagnosis.report.stand_plots import draw_residuals, draw_stiffness
    from tombo_diagnosis.report.table3_plot import draw_table3
    from tombo_flight.report.flight_plot import figure_bytes

    text = stand_json(found, study)
    (folder / JSON).write_text(text, encoding="utf-8", newline="\n")
    if extends_model(found.diagnosis):
        tool = f"tombo propeller diagnose {tombo_version()}"
        model = stand_model_text(found.diagnosis, tool, date, found.given)
        (folder / MODEL).write_text(model, encoding="utf-8", newline="\n")
    (folder / "plots").mkdir()
    figures = {RESIDUALS: draw_residuals(found, headline), STIFFNESS: draw_stiffness(found)}
    if study is not None:
        figures = {TABLE3: draw_table3(study), STIFFNESS: figures[STIFFNESS]}  # one speed only
    pictures = {}
    for name, drawn in figures.items():
        if drawn is not None:
            png = figure_bytes(drawn)
            (folder / name).write_bytes(png)
            pictures[PurePath(name).stem] = png
    page = stand_html(found, study, headline, pictures)
    (folder / REPORT).write_text(page, encoding="utf-8", newline="\n")

"""The files of a diagnosis: page, JSON, and the extended model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from tombo_diagnosis.diagnosis import JSON, MODEL, REPORT, Diagnosis
from tombo_diagnosis.extend_model import extends, model_of
from tombo_diagnosis.report.page import diagnosis_page
from tombo_flight.extended_model import Model, write_model
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.report.page import Page, page_json, write_page
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from tombo_flight.process.output_folder import OutputFolder

REPORT_FILES: Final = (JSON, REPORT)
"""Names that every diagnosis may write."""
DIAGNOSIS_FILES: Final = (*REPORT_FILES, MODEL)
"""All names that a diagnosis may write: those of an earlier one give way."""


@dataclass(frozen=True)
class NominalReference:
    """The model that the flights were compared with, and the date: the origin in `model.yaml`."""

    scenario: str
    date: str
    base: Model | None = None
    """The extended model that was given, whose effects stay."""
    vehicle: str = ""
    """The vehicle as it was given, a name or file; empty: the suite's own."""


def write_report(folder: OutputFolder, page: Page, *, pictures: bool = True) -> None:
    """Write a page as JSON and, with its pictures, as HTML.

    Raises:
        OSError: the files can't be written.
    """
    (folder / JSON).write_text(page_json(page), encoding="utf-8", newline="\n")
    if pictures:
        write_page(folder / REPORT, page)


def write_diagnosis(
    folder: OutputFolder,
    diagnosis: Diagnosis,
    against: NominalReference,
    *,
    pictures: bool = True,
    on_progress: ProgressCallback = no_progress,
) -> None:
    """Write the files of a diagnosis into an output folder, which the caller publishes.

    `pictures`: also the report.

    Raises:
        OSError: the files can't be written.
    """
    if extends(diagnosis):
        tool = f"tombo diagnose {tombo_version()}"
        model = model_of(
            diagnosis, tool=tool, scenario=against.scenario, date=against.date, base=against.base
        )
        write_model(folder / MODEL, model)
    on_progress(f"writing {REPORT}" if pictures else f"writing {JSON}", 0.0)
    page = diagnosis_page(diagnosis, str(folder.path), against.vehicle)
    write_report(folder, page, pictures=pictures)

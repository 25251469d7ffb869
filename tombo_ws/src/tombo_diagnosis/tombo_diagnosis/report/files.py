"""The files of a diagnosis: page, JSON, plots, and what can be flown next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import yaml

from tombo_diagnosis.diagnosis import JSON, MISSION, MODEL, REPORT, Diagnosis
from tombo_diagnosis.extend_model import extends, model_of
from tombo_diagnosis.report.page import diagnosis_page
from tombo_flight.extended_model import Model
from tombo_flight.json_text import plain
from tombo_flight.model_file import write_model
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.report.html import write_page
from tombo_flight.report.page import page_json
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from tombo_flight.process.output_folder import OutputFolder

PLOTS: Final = ("summary.png", "residuals.png", "drivers.png", "gains.png", "leftover.png")
DIAGNOSIS_FILES: Final = (JSON, REPORT, MODEL, MISSION, *(f"plots/{name}" for name in PLOTS))
"""All names that a diagnosis may write: those of an earlier one give way."""


@dataclass(frozen=True)
class NominalReference:
    """What the flights were compared with, and when: the provenance in `model.yaml`."""

    scenario: str
    date: str
    base: Model | None = None
    """The extended model that was given, whose effects stay."""
    vehicle: str = ""
    """The vehicle as it was given, a name or file; empty: the suite's own."""


def write_diagnosis(
    folder: OutputFolder,
    diagnosis: Diagnosis,
    against: NominalReference,
    *,
    pictures: bool = True,
    on_progress: ProgressCallback = no_progress,
) -> None:
    """Write the files of a diagnosis into an output folder, which the caller publishes.

    `pictures`: also the report and the plots.

    Raises:
        OSError: the files can't be written.
    """
    on_progress(f"writing {JSON}", 0.0)
    page = diagnosis_page(diagnosis, str(folder.path), against.vehicle)
    (folder / JSON).write_text(page_json(page), encoding="utf-8", newline="\n")
    _write_mission(folder, diagnosis)
    if extends(diagnosis):
        tool = f"tombo diagnose {tombo_version()}"
        model = model_of(
            diagnosis, tool=tool, scenario=against.scenario, date=against.date, base=against.base
        )
        write_model(folder / MODEL, model)
    if pictures:
        on_progress(f"writing {REPORT}", 0.2)
        write_page(folder / REPORT, page)
        _draw(folder, diagnosis, on_progress)


def _write_mission(folder: OutputFolder, diagnosis: Diagnosis) -> None:
    experiment = diagnosis.separating_experiment
    if experiment is None or not experiment.mission:
        return
    text = yaml.safe_dump(plain(experiment.mission), sort_keys=False, allow_unicode=True)
    head = "".join(f"# {line}\n" for line in experiment.text.splitlines())
    (folder / MISSION).write_text(head + text, encoding="utf-8", newline="\n")


def _draw(folder: OutputFolder, diagnosis: Diagnosis, on_progress: ProgressCallback) -> None:
    from tombo_diagnosis.report import figures
    from tombo_diagnosis.report.leftover_figure import draw_leftover
    from tombo_flight.report.flight_plot import figure_bytes

    draw = [
        figures.draw_summary, figures.draw_residuals, figures.draw_drivers, figures.draw_gains,
        *([draw_leftover] if diagnosis.leftover is not None else []),
    ]  # fmt: skip
    (folder / "plots").mkdir()
    for k, (name, draw_figure) in enumerate(zip(PLOTS, draw, strict=False)):
        on_progress(f"drawing {name}", 0.3 + 0.7 * k / len(PLOTS))
        (folder / f"plots/{name}").write_bytes(figure_bytes(draw_figure(diagnosis)))

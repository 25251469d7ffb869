"""The files of a diagnosis: report, JSON, plots, and what can be flown next."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Final

import yaml

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.extend_model import extends, model_of
from tombo_flight.extended_model import Model
from tombo_flight.json_text import as_json, plain
from tombo_flight.model_file import write_model
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from tombo_flight.process.output_folder import OutputFolder

JSON: Final = "diagnosis.json"
REPORT: Final = "report.html"
MODEL: Final = "model.yaml"
MISSION: Final = "separating_experiment.yaml"
PLOTS: Final = ("summary.png", "residuals.png", "drivers.png", "gains.png", "leftover.png")
DIAGNOSIS_FILES: Final = (JSON, REPORT, MODEL, MISSION, *(f"plots/{name}" for name in PLOTS))
"""All names that a diagnosis may write: those of an earlier one give way."""


def diagnosis_mapping(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the content of `diagnosis.json`: plain values, None for what is not finite."""
    left = diagnosis.leftover
    if left is not None:
        left = dataclasses.replace(left, samples=())
    values = dataclasses.asdict(dataclasses.replace(diagnosis, residuals=(), leftover=left))
    if left is not None:
        del values["leftover"]["samples"]
    del values["residuals"]
    for cause in values["causes"]:
        del cause["signature"]
        cause["theta"] = {theta.pop("name"): theta for theta in cause["theta"]}
    for change in values["changed"]:
        change["theta"] = {theta.pop("name"): theta for theta in change["theta"]}
    experiment = values["separating_experiment"]
    if experiment is not None:
        experiment["mission_file"] = MISSION if experiment.pop("mission") else None
    mapping: dict[str, Any] = plain({**values, "version": tombo_version()})
    return mapping


def diagnosis_json(diagnosis: Diagnosis) -> str:
    """Return the text of `diagnosis.json`; equal diagnoses give equal bytes."""
    return as_json(diagnosis_mapping(diagnosis))


@dataclasses.dataclass(frozen=True)
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
    (folder / JSON).write_text(diagnosis_json(diagnosis), encoding="utf-8", newline="\n")
    _write_mission(folder, diagnosis)
    if extends(diagnosis):
        tool = f"tombo diagnose {tombo_version()}"
        model = model_of(
            diagnosis, tool=tool, scenario=against.scenario, date=against.date, base=against.base
        )
        write_model(folder / MODEL, model)
    if pictures:
        on_progress(f"writing {REPORT}", 0.2)
        from tombo_diagnosis.report.diagnosis_report import write_diagnosis_report

        write_diagnosis_report(diagnosis, folder / REPORT, str(folder.path), against.vehicle)
        _draw(folder, diagnosis, on_progress)


def _write_mission(folder: OutputFolder, diagnosis: Diagnosis) -> None:
    found = diagnosis.separating_experiment
    if found is None or not found.mission:
        return
    text = yaml.safe_dump(plain(found.mission), sort_keys=False, allow_unicode=True)
    head = "".join(f"# {line}\n" for line in found.text.splitlines())
    (folder / MISSION).write_text(head + text, encoding="utf-8", newline="\n")


def _draw(folder: OutputFolder, diagnosis: Diagnosis, on_progress: ProgressCallback) -> None:
    from tombo_diagnosis.report import diagnosis_plots
    from tombo_diagnosis.report.diagnosis_poster import diagnosis_poster
    from tombo_diagnosis.report.leftover_plot import draw_leftover
    from tombo_flight.report.flight_plot import figure_bytes

    plots = diagnosis_plots
    draw = [diagnosis_poster, plots.draw_residuals, plots.draw_drivers, plots.draw_gains]
    draw += [draw_leftover] if diagnosis.leftover is not None else []
    (folder / "plots").mkdir()
    for k, (name, figure) in enumerate(zip(PLOTS, draw, strict=False)):
        on_progress(f"drawing {name}", 0.3 + 0.7 * k / len(PLOTS))
        (folder / f"plots/{name}").write_bytes(figure_bytes(figure(diagnosis)))

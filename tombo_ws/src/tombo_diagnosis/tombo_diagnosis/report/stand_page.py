"""The page of a stand diagnosis, with its figure, and its files."""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure

from tombo_diagnosis.diagnosis import Diagnosis, diagnosis_mapping
from tombo_diagnosis.extend_model import extends, model_of
from tombo_diagnosis.report.files import REPORT_FILES, write_report
from tombo_diagnosis.report.page import cause_sections, report_page
from tombo_diagnosis.report.words import headline
from tombo_diagnosis.stand.diagnose import of_other_runs
from tombo_diagnosis.wording import display_name, percent
from tombo_dynamics.propeller import RPM
from tombo_dynamics.propeller.effects import CHANNELS, STAND_EFFECTS
from tombo_flight.extended_model import write_model
from tombo_flight.json_text import plain
from tombo_flight.report import style
from tombo_flight.report.page import Item, Page, Picture, Section, Table, Text
from tombo_flight.report.style import new_figure
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.thrust_constant import ThrustConstant
    from tombo_flight.process.output_folder import OutputFolder

MODEL: Final = "stand_model.yaml"
STAND_FILES: Final = (*REPORT_FILES, MODEL)
"""All names that a stand diagnosis may write."""
_UNITS: Final = {
    "thrust": ("N", 1.0), "torque": ("mN m", 1e3), "beta": ("deg", 180.0 / math.pi),
    "reference_speed": ("rpm", 1.0 / RPM),
}  # fmt: skip


def write_stand(folder: OutputFolder, stand: StandDiagnosis, date: str) -> None:
    """Write the files of a stand diagnosis into an output folder, which the caller publishes.

    Raises:
        OSError: the files can't be written.
    """
    lasting = of_other_runs(stand.diagnosis)
    if extends(lasting):
        tool = f"tombo propeller diagnose {tombo_version()}"
        model = model_of(
            lasting, tool=tool, date=date, scenario=lasting.model, base=stand.given,
            registry=STAND_EFFECTS,
        )  # fmt: skip
        write_model(folder / MODEL, model)
    write_report(folder, stand_page(stand))


def stand_mapping(stand: StandDiagnosis) -> dict[str, Any]:
    """Return the content of `diagnosis.json`: that of flights, `runs` for their `flights`."""
    mapping = diagnosis_mapping(stand.diagnosis)
    mapping["runs"] = mapping.pop("flights")
    del mapping["vehicle"]
    if stand.constant is not None:
        mapping["thrust_constant"] = plain(asdict(stand.constant))
    return mapping


def stand_page(stand: StandDiagnosis) -> Page:
    """Return the page of a stand diagnosis."""
    diagnosis, k = stand.diagnosis, stand.constant
    caption = "Measured less model over speed, before and after; grey: twice the noise of a point"
    return report_page(
        diagnosis,
        headline(diagnosis, "these runs", "The model"),
        [
            Section("What would settle it", _settling(diagnosis)),
            Section("The gap", [Picture(partial(draw_residuals, stand), caption)], "page"),
            Section("k_T", [] if k is None else _constant(k)),
            *cause_sections(diagnosis),
        ],
        eyebrow="Tombo thrust stand",
        what="table",
        data=stand_mapping(stand),
    )


def _settling(diagnosis: Diagnosis) -> list[Item]:
    """Return what to measure next; nothing if no question is open."""
    experiment = diagnosis.separating_experiment
    steps = {
        "unknown": "Check mount, cable and cell, then measure again with another propeller.",
        "named": "Measure once more at speeds these runs do not have, with --model "
        "stand_model.yaml: the verdict should be none."
        if extends(of_other_runs(diagnosis))
        else "Measure the same propeller again, read thermometer and barometer: does it repeat?",
    }
    texts = [experiment.text if experiment else "", steps.get(diagnosis.verdict, "")]
    return [Text([text]) for text in texts if text]


def _constant(k: ThrustConstant) -> list[Item]:
    """Return k_T with its interval, with a free zero, and of each run."""
    rows = [
        ("all runs", f"{k.k_T:.4g} N s²", f"{k.low:.4g} to {k.high:.4g}", "0"),
        (f"zero at {k.offset_N:.2g} N", f"{k.with_offset:.4g} N s²", "",
         percent(k.with_offset / k.k_T - 1.0, 2)),
        *((run, f"{k_T:.4g} N s²", "", percent(k_T / k.k_T - 1.0, 2))
          for run, k_T in k.runs.items() if len(k.runs) > 1),
    ]  # fmt: skip
    return [Table(("k_T by rotor", "value", "95 % interval", "off by"), rows, "limits")]


def draw_residuals(stand: StandDiagnosis) -> Figure:
    """Draw measured minus model over speed, before and after, a row for each channel."""
    problem = stand.findings.problem
    points = problem.points
    before = problem.residual(problem.final(problem.null_hypothesis))
    after = problem.unexplained(stand.findings.search.best.fit)
    channels = [c for c in points.measured if problem.seen[:, c].any()]
    with new_figure(9.6, 0.7 + 2.5 * len(channels), 100, layout="constrained") as figure:
        axes = figure.subplots(len(channels), 2, squeeze=False, sharex="col", sharey="row")
        for row, c in zip(axes, channels, strict=True):
            unit, factor = _UNITS[CHANNELS[c]]
            sides = ((before, "as it was"), (after, "with what was found"))
            for axis, (left, words) in zip(row, sides, strict=True):
                for p, name in enumerate(points.propellers):
                    rows = (points.setup.propeller == p) & problem.seen[:, c]
                    x, y = points.setup.speed[rows] / RPM, left[rows, c] * factor
                    axis.plot(x, y, "o", markersize=3.2, color=f"C{p}", label=name)
                sigma = float(np.median(points.sigma[problem.seen[:, c], c])) * factor
                axis.axhspan(-2.0 * sigma, 2.0 * sigma, color=style.FAINT, alpha=0.7, zorder=0)
                axis.axhline(0.0, color=style.MUTED, linewidth=0.7)
                axis.set_title(f"{display_name(CHANNELS[c])}, model {words}", loc="left")
            row[0].set_ylabel(f"measured less model [{unit}]")
        for axis in axes[-1]:
            axis.set_xlabel("speed [rpm]")
        if len(points.propellers) > 1:
            axes[0][0].legend(fontsize=7, ncols=2)
    return figure

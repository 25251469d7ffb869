"""The page of a stand diagnosis, and its files."""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from tombo_diagnosis.diagnosis import Diagnosis, diagnosis_mapping
from tombo_diagnosis.extend_model import extends, model_of
from tombo_diagnosis.report.figures import draw_pair
from tombo_diagnosis.report.files import REPORT_FILES, write_report
from tombo_diagnosis.report.page import COLOURS, cause_sections, report_page
from tombo_diagnosis.report.residual_data import Pair
from tombo_diagnosis.report.words import headline
from tombo_diagnosis.stand.diagnose import of_other_runs
from tombo_diagnosis.wording import display_name, percent
from tombo_dynamics.propeller import RPM
from tombo_dynamics.propeller.effects import CHANNELS, STAND_EFFECTS
from tombo_flight.extended_model import write_model
from tombo_flight.json_text import plain
from tombo_flight.report.page import Group, Item, Page, Picture, Section, Table, Text
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
            lasting, tool=tool, date=date, scenario=lasting.model, base=stand.earlier_model,
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
    return report_page(
        diagnosis,
        headline(diagnosis, "these runs", "The model"),
        [
            Section("What would settle it", _settling(diagnosis)),
            Section("The gap", _gap(stand), "page"),
            Section("k_T", [] if k is None else _constant(k)),
            *cause_sections(diagnosis),
        ],
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


def _gap(stand: StandDiagnosis) -> list[Item]:
    """Return the residual of each channel over speed, before and after."""
    problem = stand.findings.problem
    before = problem.residual(problem.final(problem.null_hypothesis))
    after = problem.unexplained(stand.findings.search.best.fit)
    pictures = []
    for c in problem.points.measured:
        rows, name = problem.seen[:, c], CHANNELS[c]
        if not rows.any():
            continue
        unit, factor = _UNITS[name]
        samples = {
            "x": problem.points.setup.speed[rows] / RPM,
            "before": before[rows, c] * factor,
            "after": after[rows, c] * factor,
            "block": np.arange(np.count_nonzero(rows)),
        }
        sigma = float(np.median(problem.points.sigma[rows, c])) * factor
        pair = Pair(name, unit, "speed [rpm]", pd.DataFrame(samples), sigma, 1.0)
        caption = "Mean in slices with 95 % interval"
        pictures.append(Picture(partial(draw_pair, pair), caption, display_name(name), "narrow"))
    return [Text([COLOURS], "hint"), Group(pictures, "figures")]

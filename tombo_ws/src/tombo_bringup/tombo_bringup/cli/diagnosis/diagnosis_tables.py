"""A diagnosis on the terminal: verdict first, then why, what it is worth, and what to fly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.box import SIMPLE_HEAD
from rich.table import Column, Table
from rich.text import Text

from tombo_bringup.cli.tables import console, print_line, right
from tombo_diagnosis.extend_model import extends
from tombo_diagnosis.report.diagnosis_output import MISSION, MODEL
from tombo_diagnosis.report.diagnosis_text import (
    CLASSES,
    LABELS,
    changes,
    compared_with,
    detectable_text,
    headline,
    leading,
    leftover_text,
    next_steps,
)
from tombo_diagnosis.wording import (
    certainty,
    counted,
    display_name,
    figure,
    interval,
    percent,
    unit,
)
from tombo_flight.command_line import command_line

if TYPE_CHECKING:
    from tombo_bag.flight import Finding
    from tombo_diagnosis.diagnosis import Diagnosis
    from tombo_flight.extended_model import Gain

_COLOURS: Final = {"good": "bold green", "warn": "bold yellow", "bad": "bold red"}
_MOST_FINDINGS: Final = 10
_RIVALS: Final = 3


def print_diagnosis(
    diagnosis: Diagnosis, folder: Path | None, written: Sequence[str], vehicle: str = ""
) -> None:
    """Print what was found, and where the files are."""
    out = console(highlight=False)
    label = LABELS.get(diagnosis.verdict, diagnosis.verdict)
    colour = _COLOURS[CLASSES.get(diagnosis.verdict, "warn")]
    print_line(f"{headline(diagnosis)}.", colour)
    if compared := compared_with(diagnosis):
        print_line(compared)
    print_line(f"({label}, {certainty(diagnosis.confidence)}) {diagnosis.summary}")
    shown = detectable_text(diagnosis) if diagnosis.verdict == "none" else ""
    for line in filter(None, (shown, leftover_text(diagnosis))):
        print_line(line)
    if diagnosis.causes:
        out.print(_causes(diagnosis))
    _rivals(diagnosis)
    if diagnosis.gain:
        out.print(_gains(diagnosis.gain))
        still = sum(not changes(gain) for gain in diagnosis.gain)
        if still:
            print_line(f"{still} others do not change.")
    print_findings(diagnosis.prechecks, "fault", "warning")
    for note in diagnosis.notes:
        print_line(f"Note: {note}")
    _next(diagnosis, folder, vehicle)
    if folder is not None:
        print_line(f"Wrote {', '.join(written)} to {folder}")


def _causes(diagnosis: Diagnosis) -> Table:
    first = "it may be" if diagnosis.verdict == "set" else "cause"
    columns = (Column(first), *right("sure"), Column("parameter"), *right("value"))
    table = Table(*columns, "95 % interval", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for cause in leading(diagnosis):
        for k, theta in enumerate(cause.theta):
            value, low, high = interval(theta)
            table.add_row(
                Text("" if k else display_name(cause.effect), "bold"),
                "" if k else certainty(cause.confidence),
                Text(theta.name),
                Text(f"{value} {unit(theta.unit)}".strip()),
                f"{low} to {high}",
            )
    return table


def _rivals(diagnosis: Diagnosis) -> None:
    """Print who else was likely, and how many could not be seen."""
    members = {cause.effect for cause in diagnosis.causes}
    rivals = [
        f"{display_name(score.effect)} ({certainty(score.probability)})"
        for score in diagnosis.candidates
        if score.effect not in members and score.excited and score.probability >= 0.005
    ][:_RIVALS]
    alone = len(members) < 2 or diagnosis.verdict == "set"
    if rivals and alone:  # of several causes, who would be the only one says nothing
        print_line(f"Next likely: {', '.join(rivals)}")
    blind = sum(not score.excited for score in diagnosis.candidates)
    if blind:
        print_line(
            f"{blind} of {len(diagnosis.candidates)} candidates can't be seen in these flights."
        )


def _gains(gains: Sequence[Gain]) -> Table:
    title = Text("Prediction error on flights held out from selection and fit")
    columns = [Column(heading, no_wrap=True) for heading in ("channel", "ahead")]
    columns += right("error", "less by", "interval", no_wrap=True)
    table = Table(
        *columns, box=SIMPLE_HEAD, title=title, title_justify="left", padding=(0, 1, 0, 0)
    )
    for gain in filter(changes, gains):
        known = math.isfinite(gain.low) and math.isfinite(gain.high)
        error = f"{figure(gain.before)} → {figure(gain.after)} {unit(gain.unit)}"
        table.add_row(
            Text(display_name(gain.channel)),
            Text(gain.horizon),
            Text(error.strip()),
            percent(gain.reduction),
            f"{percent(gain.low)} to {percent(gain.high)}" if known else "–",
        )
    return table


def print_findings(prechecks: Sequence[Finding], *severities: str) -> None:
    """Print what checks of the logs found: one line for what several flights have alike."""
    flights: dict[Finding, list[str]] = {}
    for severity in severities:
        for f in prechecks:
            if f.severity == severity:
                flights.setdefault(replace(f, flight=""), []).append(f.flight)
    found = list(flights.items())
    for f, (name, *others) in found[:_MOST_FINDINGS]:
        at = f" at {f.start_s:.2f} s" if math.isfinite(f.start_s) else ""
        more = f" and {counted(len(others), 'other')}" if others else ""
        style = "bold yellow" if f.severity == "fault" else "yellow"
        print_line(f"{f.severity.capitalize()}: {name}{more}{at}: {f.check}: {f.message}", style)
    if len(found) > _MOST_FINDINGS:
        print_line(f"... and {len(found) - _MOST_FINDINGS} more, in diagnosis.json", "yellow")


def _next(diagnosis: Diagnosis, folder: Path | None, vehicle: str) -> None:
    experiment = diagnosis.separating_experiment
    if experiment is not None:
        print_line(f"Fly next: {experiment.text}", "bold")
        if experiment.mission and folder is not None:
            mission = ("fly", str(folder / MISSION))
            print_line(f"  {command_line(mission, [('--vehicle', vehicle)])}", "bold")
    if extends(diagnosis) and folder is not None:
        print_line("The extended model flies:", "bold")
        options = [("--model", str(folder / MODEL)), ("--vehicle", vehicle)]
        print_line(f"  {command_line(('fly',), options)}", "bold")
    for step in next_steps(diagnosis):
        print_line(f"Then: {step}" if diagnosis.verdict == "set" else f"Next: {step}")

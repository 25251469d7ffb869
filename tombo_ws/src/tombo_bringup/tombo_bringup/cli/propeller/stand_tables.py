"""A stand diagnosis on the terminal: verdict, causes, k_T and what limits it, what to measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Column, Table
from rich.text import Text

from tombo_bringup.cli.tables import console, print_line, right
from tombo_diagnosis.report.diagnosis_text import CLASSES, LABELS
from tombo_diagnosis.stand.model_differences import differences_from_model
from tombo_diagnosis.wording import capital, certainty, display_name, figure, listed, percent

if TYPE_CHECKING:
    from tombo_diagnosis.diagnosis import Diagnosis
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.table3 import Table3
    from tombo_diagnosis.stand.thrust_constant import ThrustConstant

_COLOURS = {"good": "bold green", "warn": "bold yellow", "bad": "bold red"}
_RPM = 30.0 / math.pi
_BINS = 8
_EASIEST = 8
_NAMED = 4
"""Members of a set that a headline names."""


def stand_headline(diagnosis: Diagnosis) -> str:
    """Return the verdict as one sentence."""
    causes = [display_name(c.effect) for c in diagnosis.causes]
    differences = differences_from_model(diagnosis.causes)
    if differences and diagnosis.verdict == "named":
        new = [display_name(c.effect) for c in diagnosis.causes if not differences_from_model([c])]
        parts = [*differences, *([f"it is {listed(new, 'and')}"] if new else [])]
        return capital("; ".join(parts))
    if diagnosis.verdict == "set" and len(diagnosis.set) > _NAMED:
        count = len(diagnosis.set)
        return f"One of {count} causes, {causes[0]} likeliest: these runs can’t tell"
    return {
        "none": "The model agrees with these runs",
        "unknown": "Something is wrong that no known effect explains",
        "named": f"It is {listed(causes, 'and')}",
        "set": f"It is {listed(diagnosis.set, 'or')}: these runs can’t tell",
        "partly_explained": f"Part of it is {listed(causes, 'and')}; something else is left",
    }[diagnosis.verdict]


def print_stand(
    found: StandDiagnosis, study: Table3 | None, folder: Path | None, written: Sequence[str]
) -> None:
    """Print what was found, and where the files are."""
    out = console(highlight=False)
    d = found.diagnosis

    print_line(f"{stand_headline(d)}.", _COLOURS[CLASSES[d.verdict]])
    if study is not None:
        from tombo_diagnosis.stand.table3 import statement

        print_line(statement(study), "bold")
    print_line(f"({LABELS[d.verdict]}, {certainty(d.confidence)}) {d.summary}")
    if d.causes:
        out.print(_causes(d))
    if found.constant is not None:
        out.print(_limits(found.constant))
    if study is not None:
        _print_table3(study)
    else:
        out.print(_residuals(found))
    for g in d.gain:
        known = math.isfinite(g.low)
        span = f" ({percent(g.low)} to {percent(g.high)})" if known else ""
        print_line(
            f"Held out, {display_name(g.channel)}: {figure(g.before)} → {figure(g.after)} "
            f"{g.unit}, less by {percent(g.reduction)}{span}"
        )
    for f in d.prechecks:
        print_line(f"{f.severity.capitalize()}: {f.flight}: {f.check}: {f.message}",
             "yellow" if f.severity != "info" else "")  # fmt: skip
    for note in d.notes:
        print_line(f"Note: {note}")
    if d.separating_experiment is not None:
        e = d.separating_experiment
        print_line(
            f"Measure next: {e.text} (expected log Bayes factor {e.separation:.1f}, now "
            f"{e.present:.1f}).",
            "bold",
        )
    if folder is not None:
        print_line(f"Wrote {', '.join(written)} to {folder}")


def _table(title: str, *columns: Column | str) -> Table:
    return Table(
        *columns, box=SIMPLE_HEAD, title=Text(title), title_justify="left", padding=(0, 1, 0, 0)
    )


def _causes(diagnosis: Diagnosis) -> Table:
    first = "it may be" if diagnosis.verdict == "set" else "cause"
    columns = right("value", "95 % interval")
    table = Table(first, "sure", "parameter", *columns, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for cause in diagnosis.causes:
        for k, f in enumerate(cause.theta):
            unit = "" if f.unit == "1" else f" {f.unit}"
            table.add_row(
                Text("" if k else display_name(cause.effect), "bold"),
                "" if k else certainty(cause.confidence), Text(f.name),
                Text(f"{f.value:.3g}{unit}"), f"{f.low:.3g} to {f.high:.3g}",
            )  # fmt: skip
    return table


def _limits(constant: ThrustConstant) -> Table:
    title = (
        f"k_T = {constant.k_T:.4g} N s² by rotor, 95 % {constant.low:.4g} to "
        f"{constant.high:.4g}; what limits it"
    )
    table = _table(title, "what", *right("of k_T"))
    for limit in constant.limits:
        table.add_row(Text(limit.what), f"{100.0 * limit.share:.2g} %")
    return table


def _residuals(found: StandDiagnosis) -> Table:
    """Return the mean residual in slices of speed, before and after."""
    problem = found.findings.problem
    c = problem.points.measured[0]
    own = problem.seen[:, c]
    speed = problem.points.setup.speed
    before = problem.residual(problem.final(problem.null_hypothesis))[:, c]
    after = problem.unexplained(found.findings.search.best.fit)[:, c]
    unit = ("N", "N m", "rad", "rad/s")[c]
    name = ("thrust", "torque", "flap angle", "second tachometer")[c]
    columns = right("rpm", "points", "model", "extended", "noise")
    table = _table(f"{name}, measured less model [{unit}]", *columns)
    edges = np.linspace(0.0, float(speed.max()) * (1.0 + 1e-9), _BINS + 1)
    for low, high in pairwise(edges):
        rows = own & (speed >= low) & (speed < high)
        if rows.any():
            noise = float(np.median(problem.points.sigma[rows, c]))
            table.add_row(
                f"{low * _RPM:.0f}–{high * _RPM:.0f}", str(int(rows.sum())),
                f"{before[rows].mean():+.2g}", f"{after[rows].mean():+.2g}", f"{noise:.1g}",
            )  # fmt: skip
    return table


def _print_table3(study: Table3) -> None:
    from tombo_diagnosis.stand.table3 import TWO_VALUES

    out = console(highlight=False)
    soft = len(study.confs) - 1
    columns = right("conf", "measured", *study.laws)
    table = _table("Table III at 2000 rpm: thrust [N]", *columns)
    for k, conf in enumerate(study.confs):
        own = (f"{values[k]:.3f}" for values in study.laws.values())
        table.add_row(str(conf), f"{study.measured[k]:.3f} ± {study.deviations[k]:.2f}", *own)
    out.print(table)
    for name in study.rms:
        out.print(
            Text(
                f"{name}: RMS error {study.rms[name]:.3f} N over the soft ones, chi² "
                f"{study.chi2[name]:.1f} of {soft}"
            )
        )
    out.print(
        Text(
            f"Rank correlation of measured thrust with stiffness: {study.spearman:.2f} "
            f"(p = {study.spearman_p:.2f})"
        )
    )
    table = _table(
        "Each configuration predicted by the others",
        *("what", "RMS error [N]", "against the mean, 95 % [N]", "fitted to all"),
    )
    for p in study.predictions:
        span = f"{p.low:+.3f} to {p.high:+.3f}" if p.low != p.high else "–"
        table.add_row(display_name(p.what), f"{p.rmse:.4f}", span, p.parameter)
    out.print(table)
    out.print(Text(TWO_VALUES), soft_wrap=True)
    table = _table(
        "What would tell stiffening from all others (log Bayes factor 4)",
        *("measure", "closest rival", "difference", "noise at most", "of the reading"),
    )
    for s in study.settling[:_EASIEST]:
        table.add_row(
            s.what, display_name(s.rival), f"{s.difference:.3g} {s.unit}",
            f"{s.sigma:.2g} {s.unit}", f"{100.0 * s.sigma / s.expected:.1f} %",
        )  # fmt: skip
    out.print(table)

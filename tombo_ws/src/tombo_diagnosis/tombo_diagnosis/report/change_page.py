"""The page of a comparison with healthy flights."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_diagnosis.change.diagnose import ChangeData
from tombo_diagnosis.change.features import Features
from tombo_diagnosis.change.verdict import headline
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.report.page import cause_table, report_page
from tombo_diagnosis.wording import counted
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.page import Page, Picture, Section


def change_page(diagnosis: Diagnosis, data: ChangeData) -> Page:
    """Return the page of a comparison; its title names a fault of a log: it may be all of it."""
    faulty = sorted({f.flight for f in diagnosis.prechecks if f.severity == "fault"})
    title = headline(diagnosis.verdict, tuple(c.label for c in diagnosis.changed))
    if faulty:
        where = f"the log {faulty[0]}" if len(faulty) == 1 else counted(len(faulty), "log")
        title = f"Fault in {where}; {title[:1].lower()}{title[1:]}"
    caption = (
        "Each dot is a flight, each bar the mean. Demand: thrust that the healthy drive curve "
        "reads from the commands, against a quarter of the weight"
    )
    picture = Picture(partial(draw_change, data), caption, "Healthy and new flights")
    changed = diagnosis.changed
    return report_page(
        diagnosis,
        title,
        [
            Section("What has changed", [picture], "page"),
            Section("What it may be", [cause_table(changed)] if changed else []),
        ],
    )


def draw_change(data: ChangeData) -> Figure:
    """Draw demand a rotor, shake and swing of healthy and new flights."""
    level = np.mean([f.demand for f in data.healthy], axis=0)
    base = np.mean([[*f.shake, f.swing] for f in data.healthy], axis=0)
    with new_figure(9.0, 3.4, 100, layout="constrained") as sheet:
        left, right = sheet.subplots(1, 2, width_ratios=(4, 3))
        names = [name.replace("_", "\n") for name in ROTOR_NAMES]
        _bars(left, names, data, lambda f: 100.0 * np.expm1(f.demand - level))
        left.set_ylabel("demand against healthy [%]")
        names = ["commands\n> 10 Hz", "acceleration\n> 10 Hz", "swing\n0.35 to 1.6 Hz"]
        _bars(right, names, data, lambda f: np.exp(np.array([*f.shake, f.swing]) - base))
        right.set_ylabel("against healthy [1]")
        left.legend(loc="best")
    return sheet


def _bars(
    axes: Axes, names: list[str], data: ChangeData, values_of: Callable[[Features], Array]
) -> None:
    at = np.arange(len(names))
    for name, flights, colour, offset in (
        ("healthy", data.healthy, style.BLUE, -0.2),
        ("new", data.new, style.VERMILLION, 0.2),
    ):
        rows = np.array([values_of(f) for f in flights])
        axes.bar(at + offset, rows.mean(axis=0), 0.36, color=colour, alpha=0.45, label=name)
        for row in rows:
            axes.plot(at + offset, row, "o", color=colour, markersize=3.5)
    axes.axhline(0.0, color=style.MUTED, linewidth=0.8)
    axes.set_xticks(at, names)

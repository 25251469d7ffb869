"""The page of a comparison of new flights with healthy flights of the same vehicle."""

from __future__ import annotations

import numpy as np

from tombo_diagnosis.change.diagnose import ChangeData
from tombo_diagnosis.change.features import SWING
from tombo_diagnosis.change.verdict import headline
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.report.page import cause_table, report_page
from tombo_diagnosis.wording import counted, display_name, percent
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_flight.report.page import Page, Section, Table


def change_page(diagnosis: Diagnosis, data: ChangeData) -> Page:
    """Return the page of a comparison.

    A fault of a log comes first in the title: it alone may be why the flights differ.

    Args:
        diagnosis: the result.
        data: features of the flights on both sides.
    """
    faulty = sorted({f.flight for f in diagnosis.prechecks if f.severity == "fault"})
    title = headline(diagnosis.verdict, tuple(c.label for c in diagnosis.changed))
    if faulty:
        where = f"the log {faulty[0]}" if len(faulty) == 1 else counted(len(faulty), "log")
        title = f"Fault in {where}; {title[:1].lower()}{title[1:]}"
    changed = diagnosis.changed
    return report_page(
        diagnosis,
        title,
        [
            Section("What has changed", [feature_table(data)]),
            Section("What it may be", [cause_table(changed)] if changed else []),
        ],
    )


def feature_table(data: ChangeData) -> Table:
    """Return the demand of each rotor, shake and swing [%], relative to the mean in health.

    Features are logarithms (`Features.vector`), so a difference is a ratio.
    """
    healthy, new = (
        np.array([f.vector[: SWING + 1] for f in flights]) for flights in (data.healthy, data.new)
    )
    healthy_change, new_change = (np.expm1(x - healthy.mean(axis=0)) for x in (healthy, new))
    names = [f"demand of rotor {display_name(name)}" for name in ROTOR_NAMES]
    names += ["commands above 10 Hz", "acceleration above 10 Hz", "swing, 0.35 to 1.6 Hz"]
    rows = [
        (name, percent(now.mean(), 1), f"{percent(before.min(), 1)} to {percent(before.max(), 1)}")
        for name, now, before in zip(names, new_change.T, healthy_change.T, strict=True)
    ]
    head = ("against the mean of healthy flights", "new flights", "single healthy flights")
    note = "Demand: thrust that the healthy drive curve reads from the commands, over the weight."
    return Table(head, rows, note=note)

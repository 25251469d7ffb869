"""The page of a comparison with healthy flights."""

from __future__ import annotations

import numpy as np

from tombo_diagnosis.change.diagnose import ChangeData
from tombo_diagnosis.change.verdict import headline
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.report.page import cause_table, report_page
from tombo_diagnosis.wording import counted, display_name, percent
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_flight.report.page import Page, Section, Table


def change_page(diagnosis: Diagnosis, data: ChangeData) -> Page:
    """Return the page of a comparison; its title names a fault of a log: it may be all of it."""
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
    """Return the demand of each rotor, shake and swing against the mean of healthy flights."""
    healthy, new = (np.array([f.vector[:7] for f in each]) for each in (data.healthy, data.new))
    old, now = (np.expm1(each - healthy.mean(axis=0)) for each in (healthy, new))
    names = [f"demand of rotor {display_name(name)}" for name in ROTOR_NAMES]
    names += ["commands above 10 Hz", "acceleration above 10 Hz", "swing, 0.35 to 1.6 Hz"]
    rows = [
        (name, percent(x.mean(), 1), f"{percent(y.min(), 1)} to {percent(y.max(), 1)}")
        for name, x, y in zip(names, now.T, old.T, strict=True)
    ]
    head = ("against the mean of healthy flights", "new flights", "single healthy flights")
    note = "Demand: thrust that the healthy drive curve reads from the commands, over the weight."
    return Table(head, rows, note=note)

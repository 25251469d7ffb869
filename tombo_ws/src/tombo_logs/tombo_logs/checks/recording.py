"""What every reader of a flight needs of its recording: one body, one clock, possible values.

The checks of the motion begin with it, and the search for the cause of a crash, to which those
checks do not apply.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Flight, RefusedLog, Series
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_logs.checks.clocks.clock_offsets import one_clock
from tombo_logs.checks.clocks.stamps import check_pose_rate, no_common_time, other_units
from tombo_logs.checks.samples import clean_series, nothing_left

_STEADY: Final = 1e-6
"""Range of a command over its size below which it never changes."""
_LEAST: Final = 50


def recorded(log: Flight) -> tuple[dict[str, Series], list[Finding]]:
    """Return the usable channels, cleaned and on one clock, and the findings.

    Raises:
        RefusedLog: the poses are those of several bodies, or their stamps are in no known unit.
    """
    position = log.series.get("position")
    apart = 0.0 if position is None else bodies_apart(position.values)
    if apart > 0.0:
        raise RefusedLog(
            log.name,
            "position",
            f"position: poses of two bodies or more take turns in one topic, {apart:.2f} m apart; "
            "accepted: one body; is the topic published twice?",
            "bodies",
        )
    series: dict[str, Series] = {}
    findings: list[Finding] = []
    for name, raw in log.series.items():
        clean, more = clean_series(log.name, name, raw)
        findings += more
        if nothing_left(clean):
            text = f"{name}: {raw.t.size} samples, {clean.t.size} of them usable; left out"
            findings.append(Finding("missing", "fault", log.name, text, channel=name))
        else:
            series[name] = clean
    for name in DRIVES:
        findings += drop_faulty(
            series, _drive(log.name, name, series[name]) if name in series else []
        )
    if "position" not in series:
        return series, findings
    check_pose_rate(log.name, series)
    findings += drop_faulty(series, other_units(log.name, series))
    series, more = one_clock(log.name, series)
    return series, [*findings, *more, *drop_faulty(series, no_common_time(log.name, series))]


def drop_faulty(series: dict[str, Series], findings: list[Finding]) -> list[Finding]:
    """Take channels with a fault out of `series`; returns the findings."""
    for f in findings:
        if f.severity == "fault":
            series.pop(f.channel, None)
    return findings


def _drive(flight: str, name: str, drive: Series) -> list[Finding]:
    """Report drives that say nothing of the rotors: constant throughout."""
    values = drive.values
    size = float(np.median(np.abs(values)))
    if len(values) >= _LEAST and np.ptp(values, axis=0).max() <= _STEADY * max(size, 1.0):
        text = (
            f"{name}: {float(np.median(values)):.4g} throughout; expected: commands that hold a "
            "vehicle in the air; another output, or not recorded; left out"
        )
        return [Finding("frozen", "fault", flight, text, channel=name, key="constant")]
    return []

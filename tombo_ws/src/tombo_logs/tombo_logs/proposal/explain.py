"""`--explain-mapping`: a log in, the text of a mapping file out, tried on the log itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tombo_bag.flight import Airframe, Flight, Series
from tombo_bag.recording import Recording
from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.proposal.mapping_text import mapping_text
from tombo_logs.proposal.propose import Line, Proposal, propose
from tombo_logs.proposal.topics import propose_topics, reordered
from tombo_logs.readers.csv_mapping import LogMapping, parse_mapping, shipped
from tombo_logs.readers.csv_table import open_table
from tombo_logs.readers.log_reader import kind_of, read_log

_SHOWN = {"unit", "frame", "rpm", "stamps", "missing", "frozen", "gap", "duplicate", "damage"}
"""Checks that say whether a mapping is right."""
_MOST = 8
_SAMPLES = 60_000


def explain_mapping(path: Path) -> str:
    """Return a mapping file for a log, with a reason for each line and what is doubtful.

    Raises:
        InputError: it can't be read, or nothing in it can be used.
    """
    if not path.exists():
        raise InputError(f"'{path}' does not exist; accepted: one log")
    kind = kind_of(path)
    if kind == "table":
        return _of_table(path)
    log, why = _tried(path, None)
    if kind != "recording":
        if log is None:
            raise InputError(why)
        return _text(Proposal(), path, _as_read(log), None)
    return _of_recording(path, log)


def _of_table(path: Path) -> str:
    table = open_table(path)
    names = table.number_columns()
    if not names:
        raise InputError(f"'{path}' has no column of numbers; accepted: a table of a flight")
    columns, damage = table.numbers(names)
    proposal = propose(columns)
    twice = sorted({name for name in table.columns if table.columns.count(name) > 1})
    if twice:
        proposal.notes.append(f"{', '.join(twice)}: more than one column of that name")
    proposal.notes += damage
    if not proposal.channels:
        raise InputError(f"'{path}': {'; '.join(proposal.notes)}")
    airframe = shipped()["nanobench"].airframe if proposal.is_crazyflie else None
    return _text(proposal, path, [], airframe)


def _of_recording(path: Path, log: Flight | None) -> str:
    known = set() if log is None else set(log.series)
    with Recording(path) as recording:
        proposal = propose_topics(recording, known)
        there = sorted(recording.topics)
    if log is None and not proposal.channels:
        raise InputError(f"'{path}' has no poses; topics there: {', '.join(there) or 'none'}")
    if proposal.channels:
        proposal = _ordered(path, proposal)
    return _text(proposal, path, [] if log is None else _as_read(log), None)


def _ordered(path: Path, proposal: Proposal) -> Proposal:
    """Put rotors into the order that the motion tells."""
    log, _ = _tried(path, _parsed(mapping_text(proposal, path.name, [], None)), checked=False)
    if log is None or "gyro" not in log.series:
        return proposal

    def turned(line: Line) -> Line:
        drive = log.series.get(line.key) if log is not None else None
        rotors = line.key in ("rotor_speed", "motor_command") and drive is not None
        return reordered(line, drive, log.series["gyro"]) if rotors and drive else line

    lines = [turned(line) for line in proposal.channels]
    return Proposal(proposal.top, lines, proposal.notes, proposal.is_crazyflie)


def _text(proposal: Proposal, path: Path, remarks: list[str], airframe: Airframe | None) -> str:
    """Return the mapping, after reading the log with it: what the checks say stands in it."""
    log, why = _tried(path, _parsed(mapping_text(proposal, path.name, [], airframe)))
    findings = () if log is None else log.findings
    messages = [f.message for f in findings if f.check in _SHOWN and f.severity != "info"]
    checked = [f"The checks say: {text}" for text in dict.fromkeys([why] if why else messages)]
    if log is not None and not checked:
        checked = ["Read with this mapping, the checks find no contradiction in the log."]
    return mapping_text(proposal, path.name, [*remarks, *checked[:_MOST]], airframe)


def _parsed(text: str) -> LogMapping:
    return parse_mapping(text, "proposed")


def _tried(
    path: Path, mapping: LogMapping | None, checked: bool = True
) -> tuple[Flight | None, str]:
    """Return the log as read and checked, or why not."""
    try:
        log = read_log(path, path.name, mapping)
        return (check_log(_first_part(log)) if checked else log), ""
    except InputError as error:
        return None, str(error)


def _first_part(log: Flight) -> Flight:
    """Return what a log holds up to the last of so many samples, which is enough to try it."""
    ends = [s.t[_SAMPLES] for s in log.series.values() if s.t.size > _SAMPLES]
    if not ends:
        return log
    return log.with_series({k: _until(s, min(ends)) for k, s in log.series.items()})


def _until(series: Series, end: float) -> Series:
    rows = slice(int(np.searchsorted(series.t, end)))
    arrival = None if series.arrival is None else series.arrival[rows]
    return Series(series.t[rows], series.values[rows], arrival)


def _as_read(log: Flight) -> list[str]:
    """Return where the channels are from, as read without a mapping."""
    lines = [f"As read without a mapping: {log.source}."]
    lines += [f.message for f in log.findings if f.check == "rpm" and f.severity == "info"]
    for key, series in log.series.items():
        if series.t.size > 1:
            rate = 1.0 / max(float(np.median(np.diff(series.t))), 1e-9)
            lines.append(f"{key}: {series.t.size} samples, {rate:.4g} a second")
    return lines

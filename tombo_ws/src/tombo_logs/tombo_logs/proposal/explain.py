"""`--explain-mapping`: the text of a mapping file for a log, and the findings of the checks."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import yaml

from tombo_bag.flight import Airframe
from tombo_dynamics.errors import InputError
from tombo_logs.checks import findings_of
from tombo_logs.proposal.propose import Line, Proposal, propose
from tombo_logs.readers.csv_log import fitting_mappings
from tombo_logs.readers.csv_mapping import LogMapping, parse_mapping, shipped, shipped_text
from tombo_logs.readers.csv_table import CsvTable, open_table
from tombo_logs.readers.log_reader import kind_of, read_log

_TELLING: Final = {"unit", "frame", "rpm", "stamps", "missing", "frozen", "gap", "duplicate",
                   "damage", "refused"}  # fmt: skip
"""Checks that say whether a mapping is right."""
_MOST_FINDINGS: Final = 8
_WIDTH: Final = 96


def explain_mapping(path: Path) -> str:
    """Return a mapping file for a log, with a reason for each line, and doubts.

    Of a log that needs none: the channels that are read from it.

    Raises:
        InputError: it can't be read, or nothing in it can be used.
    """
    if not path.exists():
        raise InputError(f"'{path}' does not exist; accepted: one log")
    proposal = Proposal()
    if kind_of(path) == "table":
        table = open_table(path)
        if table.mapping:
            return f"# An export of motion-capture software, read as this says.\n{table.mapping}\n"
        if fitting := fitting_mappings(table):
            name = fitting[0].name
            return f"# Needs no mapping file: the shipped one fits.\n{shipped_text(name)}"
        proposal = _of_table(table)
    airframe = shipped()["nanobench"].airframe if proposal.is_crazyflie else None
    mapping = parse_mapping(_text(proposal, path.name, [], airframe), "proposed")
    return _text(proposal, path.name, _tried(path, mapping), airframe)


def _of_table(table: CsvTable) -> Proposal:
    names = table.number_columns()
    if not names:
        raise InputError(f"'{table.path}' has no column of numbers; accepted: a table of a flight")
    columns, damage = table.numbers(names)
    proposal = propose(columns)
    twice = sorted({name for name in table.columns if table.columns.count(name) > 1})
    if twice:
        proposal.notes.append(f"{', '.join(twice)}: more than one column of that name")
    proposal.notes += damage
    if not proposal.channels:
        raise InputError(f"'{table.path}': {'; '.join(proposal.notes)}")
    return proposal


def _tried(path: Path, mapping: LogMapping) -> list[str]:
    """Return the channels that are read with a mapping, and the findings of the checks."""
    try:
        log = read_log(path, path.name, mapping)
    except InputError as error:
        if not mapping.channels:
            raise
        return [f"The checks say: {error}"]
    read = [f"{key}: {series.t.size} samples" for key, series in log.series.items()]
    found = [f for f in findings_of(log) if f.check in _TELLING and f.severity != "info"]
    said = [f"The checks say: {text}" for text in dict.fromkeys(f.message for f in found)]
    said = said or ["Read with this mapping, the checks find no contradiction in the log."]
    return [f"Read as {log.source}", *read, *said[:_MOST_FINDINGS]]


def _text(
    proposal: Proposal, source: str, remarks: Iterable[str], airframe: Airframe | None
) -> str:
    """Return a mapping file; reasons, notes and remarks are comments."""
    lines = _comment(f"Proposed for {source}. Look at the lines marked DOUBTFUL.")
    for text in [*(f"Not used: {note}." for note in proposal.notes), *remarks]:
        lines += _comment(text)
    lines.append(f"about: {_flow(f'proposed for {source}')}")
    for line in proposal.axes:
        lines += _entry(line, "")
    lines.append("channels:" if proposal.channels else "channels: {}")
    for line in proposal.channels:
        lines += _entry(line, "  ")
    if airframe is None:
        lines += _comment("The vehicle: by --vehicle, or here; without it the suite's S500:")
        lines.append("# airframe: {name: mine, mass: 1.2, arm_length: 0.225, rotor_radius: 0.12}")
    else:
        lines += _comment("DOUBTFUL: the names are a Crazyflie's; weigh yours, decks included")
        known = {key: value for key, value in vars(airframe).items() if value is not None}
        plain = {k: list(v) if isinstance(v, tuple) else v for k, v in known.items()}
        lines.append(f"airframe: {_flow(plain)}")
    return "\n".join(lines) + "\n"


def _entry(line: Line, indent: str) -> Iterable[str]:
    yield from _comment(line.why, indent)
    if line.question:
        yield from _comment(f"DOUBTFUL: {line.question}", indent)
    yield f"{indent}{line.key}: {_flow(line.content.get('', dict(line.content)))}"


def _comment(text: str, indent: str = "") -> list[str]:
    plain = re.sub(r"\s+", " ", "".join(c if c.isprintable() else " " for c in text))
    return textwrap.wrap(
        plain, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _flow(value: object) -> str:
    """Return a value as YAML in a line."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10**6,
                          allow_unicode=True)  # fmt: skip
    return text.removesuffix("\n...\n").strip()

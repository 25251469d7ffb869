"""`--explain-mapping`: a log in, the text of a mapping file out, tried on the log itself."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import yaml

from tombo_bag.columns import number_columns
from tombo_bag.flight import Airframe, Flight
from tombo_bag.recording import Recording
from tombo_bag.topics import BATTERY, IMU, POSE_TYPES
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.proposal.propose import Line, Proposal, propose
from tombo_logs.readers.bag_log import usable_topics
from tombo_logs.readers.csv_mapping import LogMapping, parse_mapping, shipped
from tombo_logs.readers.csv_table import open_table
from tombo_logs.readers.log_reader import kind_of, read_log

_TELLING: Final = {"unit", "frame", "rpm", "stamps", "missing", "frozen", "gap", "duplicate",
                   "damage"}  # fmt: skip
"""Checks that say whether a mapping is right."""
_MOST_FINDINGS: Final = 8
_WIDTH: Final = 96
_TYPES: Final = (
    *POSE_TYPES, IMU.typename, BATTERY.typename,
    *(f"std_msgs/msg/{kind}MultiArray" for kind in ("Float32", "Float64", "Int32", "UInt16")),
)  # fmt: skip


def explain_mapping(path: Path) -> str:
    """Return a mapping file for a log, with a reason for each line and what is doubtful.

    Raises:
        InputError: it can't be read, or nothing in it can be used.
    """
    if not path.exists():
        raise InputError(f"'{path}' does not exist; accepted: one log")
    kind, read, why = kind_of(path), None, ""
    if kind == "table":
        table = open_table(path)
        if table.mapping:
            return f"# An export of motion-capture software, read as this says.\n{table.mapping}\n"
        names = table.number_columns()
        if not names:
            raise InputError(f"'{path}' has no column of numbers; accepted: a table of a flight")
        columns, damage = table.numbers(names)
        proposal = propose(columns)
        twice = sorted({name for name in table.columns if table.columns.count(name) > 1})
        if twice:
            proposal.notes.append(f"{', '.join(twice)}: more than one column of that name")
        proposal.notes += damage
    else:
        read, why = _tried(path, None)
        if kind != "recording" and read is None:
            raise InputError(why)
        known = set() if read is None else set(read.series)
        proposal = _propose_topics(path, known) if kind == "recording" else Proposal()
    if read is None and not proposal.channels:
        raise InputError(f"'{path}': {'; '.join(proposal.notes)}")
    airframe = shipped()["nanobench"].airframe if proposal.is_crazyflie else None
    remarks = [] if read is None else _as_read(read)
    log, why = _tried(path, parse_mapping(_text(proposal, path.name, [], airframe), "proposed"))
    findings = () if log is None else log.findings
    said = [f.message for f in findings if f.check in _TELLING and f.severity != "info"]
    said = [f"The checks say: {text}" for text in dict.fromkeys([why] if why else said)]
    if not said:
        said = ["Read with this mapping, the checks find no contradiction in the log."]
    return _text(proposal, path.name, [*remarks, *said[:_MOST_FINDINGS]], airframe)


def _propose_topics(path: Path, known: set[str]) -> Proposal:
    """Propose topics for the channels that are not `known`: a topic is a table of its own."""
    columns: dict[str, Array] = {}
    times: dict[str, Array] = {}
    with Recording(path) as recording:
        there = sorted(recording.topics)
        for topic in usable_topics(recording, _TYPES):
            table = recording.columns(topic)
            stamps = table.get("stamp_ns", table["log_time_ns"])
            stamps = stamps if len(stamps) and stamps[0] > 0 else table["log_time_ns"]
            for name, values in number_columns(table):
                if not name.startswith("header.") and not name.endswith("_ns"):
                    columns[f"{topic} {name}"] = values
                    times[f"{topic} {name}"] = 1e-9 * (stamps - stamps[:1].sum())
    proposal = propose(columns, times)
    kept = [line for line in proposal.channels if line.key not in known]
    if "position" not in known and "position" not in {line.key for line in kept}:
        raise InputError(f"'{path}' has no poses; topics there: {', '.join(there) or 'none'}")
    axes = [] if "position" in known else proposal.axes
    return Proposal(axes, [_of_topic(line) for line in kept], proposal.notes)


def _of_topic(line: Line) -> Line:
    columns = line.content["columns"]
    assert isinstance(columns, Sequence)
    topic = str(columns[0]).lstrip("-").split(" ")[0]
    names = [str(c).replace(f"{topic} ", "") for c in columns]
    return line._replace(content={"topic": topic, **line.content, "columns": names})


def _tried(path: Path, mapping: LogMapping | None) -> tuple[Flight | None, str]:
    """Return the log as read and checked, or why not."""
    try:
        return check_log(read_log(path, path.name, mapping)), ""
    except InputError as error:
        return None, str(error)


def _as_read(log: Flight) -> list[str]:
    """Return where the channels are from, as read without a mapping."""
    lines = [f"As read without a mapping: {log.source}."]
    lines += [f.message for f in log.findings if f.check == "rpm" and f.severity == "info"]
    return lines + [f"{key}: {series.t.size} samples" for key, series in log.series.items()]


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
        lines.append(f"airframe: {_flow({k: _plain(v) for k, v in known.items()})}")
    return "\n".join(lines) + "\n"


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _entry(line: Line, indent: str) -> Iterable[str]:
    yield from _comment(line.why, indent)
    if line.doubt:
        yield from _comment(f"DOUBTFUL: {line.doubt}", indent)
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

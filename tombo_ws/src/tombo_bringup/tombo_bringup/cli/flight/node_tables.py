"""A flight by nodes on the terminal: how well each loop kept its time, and what went wrong."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tombo_bringup.cli.tables import print_line, print_table, show_page
from tombo_flight.report.page import Table
from tombo_flight.suite.node_diagnostics import lateness_text
from tombo_flight.suite.node_log import without_stamp

if TYPE_CHECKING:
    from tombo_flight.suite.node_flight import NodeFlight

_KEY: Final = re.compile(r"\w+ (?!PX4: )[\w.]+: ")
_FIGURE: Final = re.compile(r"\d[\d.]*")
_WARNINGS: Final = 12
"""More are not shown."""


def print_node_flight(flown: NodeFlight, path: Path, files: Sequence[str], as_json: bool) -> None:
    """Print a flight by nodes: its summary as JSON, or tables and the files in `path`."""
    show_page(flown.flight.page, as_json)
    if not as_json:
        print_nodes(flown)
        print_line(f"{path}: {', '.join(files)}")


def print_nodes(flown: NodeFlight) -> None:
    """Print the loops, latency or PX4, the recorder's losses, and the nodes' troubles."""
    summary = flown.flight.summary
    if summary["loops"]:
        _print_loops(summary["loops"])
    recorder = summary["recorder"]
    recorded = (
        f"{_number(recorder['messages'], 'messages recorded', 0)}, "
        f"{_number(recorder['lost'], 'lost', 0)}."
    )
    if "px4" in summary:
        recorded = f"{_px4(summary['px4'])}; {recorded}"
    elif summary["loops"]:
        recorded = f"{_latency(summary)}; {recorded}"
    print_line(recorded)
    troubles = grouped(flown.warnings)
    for trouble in troubles[:_WARNINGS]:
        print_line(trouble, "yellow")
    if len(troubles) > _WARNINGS:
        print_line(f"... and {len(troubles) - _WARNINGS} more warnings", "yellow")
    for end in flown.died:
        print_line(f"{end.name} has ended, {end.exit_text}; see nodes.log", "bold red")


def _print_loops(loops: Mapping[str, Mapping[str, Any]]) -> None:
    rows = [
        (
            name,
            _number(loop["rate_hz"], "Hz", 1),
            _late(loop["jitter_p50_us"]),
            _late(loop["jitter_p99_us"]),
            _number(loop["missed"], "", 0),
        )
        for name, loop in loops.items()
    ]
    print_table(Table(("", "rate", "median late", "p99 late", "missed"), rows, title="Loops"))


def grouped(warnings: Sequence[tuple[str, str]]) -> list[str]:
    """Return a line for each node and kind of warning: its first text, and how often.

    Two texts are of one kind if they have the same key, else if they differ in figures only.
    """
    texts: dict[tuple[str, str], list[str]] = {}
    for node, line in warnings:
        text = without_stamp(line)
        key = _KEY.match(text)
        kind = key[0] if key else _FIGURE.sub("#", text)
        texts.setdefault((node, kind), []).append(text)
    return [
        f"{node}: {first}{f' ({1 + len(more)} times)' if more else ''}"
        for (node, _), (first, *more) in texts.items()
    ]


def _latency(summary: Mapping[str, Any]) -> str:
    latency = summary["latency_gyro_to_command_us"]
    return (
        f"Gyro to command: {_late(latency['p50'])} in the median, {_late(latency['p99'])} at 99 %"
    )


def _px4(figures: Mapping[str, Any]) -> str:
    modes = ", ".join(f"{name} at {time_s:.1f} s" for time_s, name in figures["modes"])
    return (
        f"PX4 {figures['firmware'] or ''}: {modes or 'no modes'}; armed for "
        f"{figures['armed_duration_s']:.1f} s, mocap poses "
        f"{_number(figures['mocap_latency_ms'], 'ms', 1)} old, "
        f"{_number(figures['messages_in'], 'messages in', 0)}, "
        f"{_number(figures['messages_out'], 'out', 0)}"
    )


def print_verdict(summary: Mapping[str, Any]) -> None:
    """Print whether the machine kept the time that the figures of a flight in real time need."""
    if summary["too_slow"]:
        reasons = ", ".join(summary["too_slow"])
        print_line(f"The machine was too slow for these figures: {reasons}.", "bold yellow")
    else:
        print_line("The machine kept pace: the figures are those of the suite.")


def _late(value: Any) -> str:
    return "– us" if value is None else lateness_text(value)


def _number(value: Any, unit: str, digits: int) -> str:
    return f"– {unit}".rstrip() if value is None else f"{value:.{digits}f} {unit}".rstrip()

"""A flight by nodes on the terminal: how well each loop kept its time, and what went wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tombo_bringup.cli.tables import print_line, print_table, show_page
from tombo_flight.report.page import Table
from tombo_flight.suite.node_diagnostics import lateness_text
from tombo_flight.suite.supervisor import without_stamp

if TYPE_CHECKING:
    from tombo_bag.flight import Flight
    from tombo_flight.suite.node_flight import NodeRun

_WARNINGS: Final = 12
"""More are not shown."""


def print_node_flight(
    flight: Flight, run: NodeRun, path: Path, files: Sequence[str], as_json: bool
) -> None:
    """Print a flight by nodes: its summary as JSON, or tables and the files in `path`."""
    from tombo_flight.flight_output import flown_page

    show_page(flown_page(flight), as_json)
    if not as_json:
        print_nodes(flight, run)
        print_line(f"{path}: {', '.join(files)}")


def print_nodes(flight: Flight, run: NodeRun) -> None:
    """Print loops, latency and the recorder's losses, and the nodes' troubles, each once."""
    if flight.summary["loops"]:
        print_timing(flight.summary)
    troubles = list(dict.fromkeys(f"{node}: {without_stamp(x)}" for node, x in run.warnings))
    for trouble in troubles[:_WARNINGS]:
        print_line(trouble, "yellow")
    if len(troubles) > _WARNINGS:
        print_line(f"... and {len(troubles) - _WARNINGS} more warnings: nodes.log", "yellow")
    for end in run.died:
        print_line(f"{end.name} has ended, {end.exit_text}; see nodes.log", "bold red")


def print_timing(metrics: Mapping[str, Any]) -> None:
    """Print how late the loops began their runs, the latency, and the recorder's losses.

    Args:
        metrics: with the figures of `node_metrics`.
    """
    rows = [
        (
            name,
            _number(loop["rate_hz"], 3),
            *(_late(loop[f"jitter_{share}_us"]) for share in ("p50", "p99")),
            _number(loop["missed"], 0),
        )
        for name, loop in metrics["loops"].items()
    ]
    print_table(Table(("loop", "rate [Hz]", "late, median", "late, 99 %", "missed"), rows))
    latency, recorder = metrics["latency_gyro_to_command_us"], metrics["recorder"]
    print_line(
        f"Gyro to command: {_late(latency['p50'])} in the median, {_late(latency['p99'])} at 99 %;"
        f" {recorder['messages']} messages recorded, {recorder['lost']} lost."
    )


def print_verdict(summary: Mapping[str, Any]) -> None:
    """Print whether the machine kept the time that the figures of a flight in real time need."""
    if summary["too_slow"]:
        reasons = ", ".join(summary["too_slow"])
        print_line(f"The machine was too slow for these figures: {reasons}.", "bold yellow")
    else:
        print_line("The machine kept pace: the figures are those of the suite.")


def _late(value: float | None) -> str:
    return "–" if value is None else lateness_text(value)


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"

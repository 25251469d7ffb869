"""A flight by nodes on the terminal: how well each loop kept its time, and what went wrong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from tombo_bringup.suite.node_log import without_stamp

if TYPE_CHECKING:
    from tombo_bringup.node_flight import NodeFlight

_WARNINGS: Final = 12
"""More are not shown."""


def print_nodes(flown: NodeFlight) -> None:
    """Print the loops, latency or PX4, the recorder's losses, and the nodes' troubles."""
    summary = flown.flight.summary
    table = Table(box=SIMPLE_HEAD, title=Text("Loops"))
    table.add_column("")
    for heading in ("rate", "median late", "p99 late", "missed"):
        table.add_column(heading, justify="right")
    for name, loop in summary["loops"].items():
        table.add_row(
            Text(name),
            _number(loop["rate_hz"], "Hz", 1),
            _number(loop["jitter_p50_us"], "us", 0),
            _number(loop["jitter_p99_us"], "us", 0),
            _number(loop["missed"], "", 0),
        )
    console = Console()
    console.print(table)
    recorder = summary["recorder"]
    _line(
        f"{_px4(summary['px4']) if 'px4' in summary else _latency(summary)}; "
        f"{_number(recorder['messages'], 'messages recorded', 0)}, "
        f"{_number(recorder['lost'], 'lost', 0)}."
    )
    for node, line in flown.warnings[:_WARNINGS]:
        _line(f"{node}: {without_stamp(line)}", "yellow")
    if len(flown.warnings) > _WARNINGS:
        _line(f"... and {len(flown.warnings) - _WARNINGS} more warnings", "yellow")
    for end in flown.died:
        _line(f"{end.name} has ended, {end.how}; what it said is in nodes.log", "bold red")


def _latency(summary: Mapping[str, Any]) -> str:
    latency = summary["latency_gyro_to_command_us"]
    return (
        f"Gyro to command: {_number(latency['p50'], 'us', 0)} in the median, "
        f"{_number(latency['p99'], 'us', 0)} at 99 %"
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


def _number(value: Any, unit: str, digits: int) -> str:
    return f"– {unit}".rstrip() if value is None else f"{value:.{digits}f} {unit}".rstrip()


def _line(text: str, style: str = "") -> None:
    Console().print(Text(text, style), soft_wrap=True)

"""Measures how seconds and bytes grow with vehicles, flights, length, effects, cores, poses."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from tombo_benchmarks.growth.cost_growth import measure
from tombo_benchmarks.growth.growth_page import draw_growth, growth_page
from tombo_bringup.cli.tables import show_page
from tombo_flight.report.flight_plot import figure_bytes


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tombo_benchmarks.growth", description=__doc__)
    parser.add_argument(
        "--seconds", type=float, default=100.0,
        help="sizes are run as far as these allow; 3600 for vehicles to 10 000 and flights to "
        "100 000 (default: 100)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON only")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="also draw it: a PNG file")
    chosen = parser.parse_args(arguments)
    if not 1.0 <= chosen.seconds <= 1e6:
        parser.error(f"--seconds {chosen.seconds:g}: out of bounds; accepted: 1 to 1e6")
    console = Console(stderr=True)  # no spinner: its thread would be copied with its locks
    found = measure(chosen.seconds, progress=console.print)
    if chosen.picture is not None:
        chosen.picture.write_bytes(figure_bytes(draw_growth(found)))
    show_page(growth_page(found), chosen.json)


if __name__ == "__main__":
    main()

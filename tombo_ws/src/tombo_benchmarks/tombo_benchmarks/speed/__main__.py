"""Prints how fast the simulation is on this machine; `--json` for programs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from typing import Final

from tombo_benchmarks.speed.speed_measurements import measure
from tombo_bringup.cli.tables import print_table
from tombo_flight.report.page import Table

_ROWS: Final = (
    ("kernel_steps_per_s", "bare kernel, one core", "M steps/s", 1e-6, 2, "at least 3"),
    ("batch_steps_per_s", "batch of vehicles", "M steps/s", 1e-6, 2, "at least 6"),
    ("training_ticks_per_s", "training, 64 vehicles", "M ticks/s", 1e-6, 2, "at least 3"),
    ("batch_threads", "  both on threads", "", 1.0, 0, "2"),
    ("flight_real_time_factor", "whole flight", "times real time", 1.0, 0, "at least 500"),
    ("recorded_flight_real_time_factor", "  with flight.mcap", "times real time", 1.0, 0,
     "at least 60"),
    ("imports_s", "fresh process: imports", "s", 1.0, 2, ""),
    ("first_kernel_call_s", "  first kernel call", "s", 1.0, 3, "at most 1"),
    ("first_flight_s", "  first whole flight", "s", 1.0, 3, ""),
)  # fmt: skip


def speed_table(figures: Mapping[str, float | int | None]) -> Table:
    """Return the figures with the wanted ones."""
    rows = []
    for key, name, unit, scale, digits, wanted in _ROWS:
        value = figures[key]
        rows.append((name, "–" if value is None else f"{scale * value:.{digits}f}", unit, wanted))
    title = "Speed on this machine, medians"
    return Table(("", "measured", "", "wanted"), rows, title=title)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tombo_benchmarks.speed", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON only")
    chosen = parser.parse_args(arguments)
    figures = measure(lambda text: print(f"measuring: {text}", file=sys.stderr))
    if chosen.json:
        print(json.dumps(figures, indent=1))
    else:
        print_table(speed_table(figures))


if __name__ == "__main__":
    main()

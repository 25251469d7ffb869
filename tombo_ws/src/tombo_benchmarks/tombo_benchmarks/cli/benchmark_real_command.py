"""`tombo benchmark real`: real flights of known causes, asked of the commands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tombo_benchmarks.cli.benchmark_run import Scored
from tombo_bringup.cli.options import option, record
from tombo_dynamics.errors import InputError


@record
class _Real:
    data: Path | None = option(
        "--data DIR",
        "Folder with crazypad, crazyswarm2, air_garage, flights, nanobench_controllers; what is "
        "not there is left out. Default: shared/data beside the repository.",
    )
    few: int | None = option("--few N", "At most N trials of each data set. Default: all.")
    left_out: bool = option(
        "--left-out",
        "Only changes of a vehicle against its healthy flights, each with the constants that are "
        "learnt from the others.",
        False,
    )


def benchmark_real(given: _Real, scored: Scored) -> None:
    """Ask about real flights of known causes, and count right, wrong and withheld answers.

    Flights against healthy ones of the vehicle, single logs of mishaps, and healthy flights.
    With -o the page is written beside the JSON, as .html; a run that is stopped goes on with
    the same command.
    """
    few, left_out, output = given.few, given.left_out, scored.output
    if left_out and few is not None:
        raise InputError(f"--few {few}: accepted: without --left-out")
    if few is not None and few < 1:
        raise InputError(f"--few {few}: out of bounds; accepted: 1 or more")
    if output is not None and output.suffix == ".html":
        raise InputError(
            f"-o '{output}': the page has that name; accepted: another ending, of JSON"
        )
    from tombo_benchmarks.real.real_benchmark import benchmark
    from tombo_benchmarks.real.real_page import real_page
    from tombo_benchmarks.real.trials import ROOT, conditions, trials
    from tombo_bringup.cli.tables import show_page
    from tombo_flight.report.html import write_page

    folder = ROOT.parent / "shared" / "data" if given.data is None else given.data
    asked = conditions(folder) if left_out else trials(folder, few)
    rows: list[dict[str, Any]] = []

    def run(cases: int, *options: Any) -> Any:
        result = benchmark(asked, folder, left_out, cases, *options)
        rows.extend(result.cases)
        if output is not None and len(rows) == cases:  # before printing, which may be cut
            write_page(output.with_suffix(".html"), real_page(rows, result.aggregate))
        return result

    def show(found: Mapping[str, Any], cases: int) -> None:
        show_page(real_page(rows, found), as_json=False)

    name = "real --left-out" if left_out else "real" if few is None else f"real --few {few}"
    scored.score(name, run, len(asked), 0, show)

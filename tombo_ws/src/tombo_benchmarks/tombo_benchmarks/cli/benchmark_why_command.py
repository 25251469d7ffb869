"""`tombo benchmark why`: simulated crashes of known causes, asked of `tombo why`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from tombo_benchmarks.cli.benchmark_run import AsJson, Cases, Output, checked, run_and_print
from tombo_bringup.cli.options import Seed, Workers, option
from tombo_dynamics.errors import InputError
from tombo_flight.report.page import Table


def benchmark_why(
    cases: Cases = 200,
    rotorpy: Annotated[
        Path | None,
        option(
            "--rotorpy PYTHON",
            "Fly every other crash with rotorpy: the Python of an environment that has it. "
            "Default: all in the second simulator.",
        ),
    ] = None,
    seed: Seed = 0,
    workers: Workers = None,
    output: Output = None,
    as_json: AsJson = False,
) -> None:
    """Crash simulated flights by ten causes, and ask from one log each what and when it was.

    Times and sizes are drawn; vehicles, sensors and what the log has differ.
    """
    count = checked(cases, workers, output)
    if rotorpy is not None and not rotorpy.is_file():
        raise InputError(f"--rotorpy '{rotorpy}' is no file; accepted: a Python that has rotorpy")
    from tombo_benchmarks.why.crash_benchmark import benchmark

    python = "" if rotorpy is None else str(rotorpy.absolute())
    run = partial(benchmark, python)
    name = "why --rotorpy" if python else "why"
    run_and_print(name, run, cases, seed, count, output, as_json, print_score)


def print_score(found: Mapping[str, Any], cases: int) -> None:
    """Print the score of all crashes and of each kind."""
    from tombo_bringup.cli.tables import print_table

    rows = [
        (
            kind.replace("_", " "),
            str(part["cases"]),
            *(f"{100 * part[key]:.0f} %" for key in ("right", "in_time")),
            *(str(part[key]) for key in ("wrong", "abstained")),
        )
        for kind, part in [("all", found), *found["kinds"].items()]
        if part["cases"]
    ]
    head = ("", "cases", "right", "within 0.1 s", "wrong", "abstained")
    print_table(Table(head, rows, title=f"{cases} simulated crashes"))

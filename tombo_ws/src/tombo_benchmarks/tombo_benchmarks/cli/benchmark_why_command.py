"""`tombo benchmark why`: simulated crashes of known causes, asked of `tombo why`."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from tombo_benchmarks.cli.benchmark_run import AsJson, Cases, Output, checked, run_and_print
from tombo_bringup.cli.options import Seed, Workers, option
from tombo_dynamics.errors import InputError
from tombo_flight.report.page import Table


def benchmark_why(
    rotorpy: Annotated[
        Path,
        option(
            "--rotorpy PYTHON",
            "Python of an environment that has rotorpy 3.0.0 (`pip install rotorpy==3.0.0`).",
            show_default=False,
        ),
    ],
    cases: Cases = 200,
    seed: Seed = 0,
    workers: Workers = None,
    output: Output = None,
    as_json: AsJson = False,
) -> None:
    """Crash flights of rotorpy by ten causes, and ask from one log each what and when it was.

    Times and sizes are drawn; sensors and channels of the logs differ.
    """
    count = checked(cases, workers, output)
    from tombo_benchmarks.why.crash_benchmark import benchmark

    run = partial(benchmark, _checked_python(rotorpy))
    run_and_print("why", run, cases, seed, count, output, as_json, print_score)


def _checked_python(rotorpy: Path) -> str:
    """Return the absolute path of a Python that has rotorpy."""
    python = str(rotorpy.absolute())
    try:
        subprocess.run([python, "-c", "import rotorpy"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        raise InputError(
            f"--rotorpy '{rotorpy}' can't import rotorpy; accepted: the Python of an environment "
            "that has it (`python -m venv ENV; ENV/bin/pip install rotorpy==3.0.0`)"
        ) from None
    return python


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

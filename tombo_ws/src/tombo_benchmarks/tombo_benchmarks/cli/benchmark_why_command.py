"""`tombo benchmark why`: simulated crashes of known causes, asked of `tombo why`."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from tombo_benchmarks.cli.benchmark_run import DrawnCases
from tombo_bringup.cli.options import option, record
from tombo_dynamics.errors import InputError
from tombo_flight.report.page import Table


@record
class _Rotorpy:
    rotorpy: Path = option(
        "--rotorpy PYTHON",
        "Python of an environment that has rotorpy 3.0.0 (`pip install rotorpy==3.0.0`).",
        ...,
    )

    def python(self) -> str:
        """Return the absolute path of a Python that has rotorpy.

        Raises:
            InputError: it does not run, or can't import rotorpy.
        """
        python = str(self.rotorpy.absolute())
        try:
            subprocess.run([python, "-c", "import rotorpy"], check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            raise InputError(
                f"--rotorpy '{self.rotorpy}' can't import rotorpy; accepted: the Python of an "
                "environment that has it (`python -m venv ENV; ENV/bin/pip install "
                "rotorpy==3.0.0`)"
            ) from None
        return python


def benchmark_why(by: _Rotorpy, drawn: DrawnCases) -> None:
    """Crash flights of rotorpy by ten causes, and ask from one log each what and when it was.

    Times and sizes are drawn; sensors and channels of the logs differ.
    """
    from tombo_benchmarks.why.crash_benchmark import benchmark

    drawn.score_drawn("why", partial(benchmark, by.python()), 200, print_score)


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

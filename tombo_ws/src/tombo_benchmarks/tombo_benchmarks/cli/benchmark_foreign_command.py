"""`tombo benchmark foreign`: flights of the second simulator, diagnosed by the command itself."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from functools import partial

import typer

from tombo_benchmarks.cli.benchmark_run import DrawnCases, print_benchmark
from tombo_dynamics.errors import InputError


def benchmark_foreign(drawn: DrawnCases) -> None:
    """Hide causes in flights of a second simulator, and ask `tombo diagnose` about their logs.

    Equations, integrator, controller, courses, sensors and logs share nothing with
    the model that is fitted. Three vehicles; CSV in the units of a lab, or MCAP.
    """
    from tombo_benchmarks.diagnosis.foreign_evaluation import benchmark

    drawn.score_drawn("foreign", partial(benchmark, diagnose_files), 60, print_benchmark)


def diagnose_files(arguments: Sequence[str]) -> str:
    """Run `tombo diagnose` in this process and return what it prints.

    Raises:
        InputError: it refuses; the message is what it says.
        KeyboardInterrupt: a signal has stopped it.
    """
    from tombo_bringup.cli.diagnose_command import diagnose
    from tombo_bringup.cli.errors import BAD_INPUT, exit_code_of
    from tombo_bringup.cli.options import command

    app = typer.Typer(pretty_exceptions_enable=False)
    command(app)(diagnose)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = exit_code_of(lambda: app(list(arguments), standalone_mode=False))
    if code == BAD_INPUT:
        raise InputError(err.getvalue().strip().removeprefix("Error: "))
    if code:
        raise KeyboardInterrupt
    return out.getvalue()

"""Options of the commands of `tombo benchmark`, and the way from them to a score."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer

from tombo_bringup.cli.options import Draw, Shown, Workers, option, record
from tombo_flight.report.page import Page, Table

if TYPE_CHECKING:
    from tombo_benchmarks.diagnosis.runner import BenchmarkResult, Row

EXIT_CODES: Final = (
    "Exit code: 0 whatever the score; 2 for bad input or output that can't be written; 130 after "
    "Ctrl-C."
)
_MOST_CASES: Final = 100_000


@record
class Scored(Workers, Shown):
    """How a benchmark is run, and where its score goes."""

    output: Path | None = option("-o/--output FILE", "Write the JSON there as well.")

    def __post_init__(self) -> None:
        """Try the output, before hours of work.

        Raises:
            OSError: it can't be written: permissions alone do not tell (/proc, a full disk).
        """
        if self.output is not None:
            there = self.output.exists()
            self.output.open("ab").close()
            if not there:
                self.output.unlink()

    def score(
        self,
        name: str,
        examine: Callable[[int, int], Row],
        aggregate: Callable[[Sequence[Row]], dict[str, Any]],
        cases: int,
        show: Callable[[BenchmarkResult], Table | Page | list[str]],
        *,
        seed: int | None = None,
        finish: Callable[..., BenchmarkResult] | None = None,
    ) -> None:
        """Run a benchmark with a progress bar; write its JSON, print its score.

        Without a terminal each finished case is a line, if there is an output.

        Args:
            name: of the benchmark.
            examine: as of `run_benchmark`, as the next two.
            aggregate: the score of all.
            cases: how many.
            show: the result as a table, a page or lines.
            seed: of all random draws; None: 0.
            finish: (result, progress, stop) to the result that counts.

        Raises:
            typer.Exit: stopped by a signal; with an output, `OUTPUT.part` keeps the scores so far.
            OSError: the output can't be written any more.
        """
        from tombo_benchmarks.cli.journal import Journal
        from tombo_benchmarks.diagnosis.runner import run_benchmark
        from tombo_bringup.cli.progress import progress_bar
        from tombo_flight.json_text import as_json as to_json
        from tombo_flight.process.output_folder import write_whole
        from tombo_flight.process.stop_signals import StopSignals
        from tombo_flight.process.workers import process_count

        workers, seed = process_count(self.workers), seed or 0
        part = None if self.output is None else self.output.with_name(f"{self.output.name}.part")
        kept = None if part is None else Journal(part, f"{name} --seed {seed}")
        with StopSignals() as stop, progress_bar() as bar:

            def on_progress(stage: str, share: float) -> None:
                bar(stage, share)
                if part is not None and not sys.stderr.isatty():
                    typer.echo(stage, err=True)  # a run of hours in the background

            result = run_benchmark(
                examine, aggregate, cases, seed, workers, on_progress, stop.requested, kept
            )
            if finish is not None and not stop.requested():
                result = finish(result, on_progress, stop.requested)
        if stop.requested():
            goes_on = f"; the same command goes on with '{part}'" if kept else ""
            typer.echo(f"Error: interrupted{goes_on}", err=True)
            raise typer.Exit(stop.exit_code)
        text = to_json({"cases": result.cases, "aggregate": result.aggregate})
        if self.output is not None and part is not None:
            write_whole(self.output, text)
            part.unlink(missing_ok=True)
        if self.as_json:
            typer.echo(text, nl=False)
        else:
            _print(show(result))


@record
class DrawnCases(Scored, Draw):
    """A benchmark of cases that are drawn."""

    cases: int | None = option(
        "--cases N",
        "How many cases. Default: 100; stand and why 200, faults 1000.",
        bounds=(1, _MOST_CASES),
    )

    def count(self, usual: int) -> int:
        """Return the number of cases, `usual` where none is given."""
        return usual if self.cases is None else self.cases


def _print(shown: Table | Page | list[str]) -> None:
    from tombo_bringup.cli.tables import print_table, show_page

    if isinstance(shown, Table):
        print_table(shown)
    elif isinstance(shown, Page):
        show_page(shown, as_json=False)
    else:
        typer.echo("\n".join(shown))

"""What the commands of `tombo benchmark` share: options, and the way from them to a score."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import typer

from tombo_bringup.cli.options import Draw, Shown, Workers, option, record
from tombo_bringup.cli.result_files import unwritable, write_file
from tombo_flight.report.page import Cell, Table

EXIT_CODES: Final = (
    "Exit code: 0 whatever the score; 2 for bad input or output that can't be written; 130 after "
    "Ctrl-C."
)
_MOST_CASES: Final = 100_000

THRESHOLDS: Final[tuple[tuple[str, str, str, float, float], ...]] = (
    ("top1_large", "right cause first, large effect", ">=", 0.97, 100.0),
    ("top1_medium", "right cause first, medium effect", ">=", 0.85, 100.0),
    ("top1_small", "right cause first, small effect", ">=", 0.65, 100.0),
    ("another_named", "another cause named than the one that is there", "<=", 0.05, 100.0),
    ("unseen_named", "something named where nothing can be seen", "<=", 0.05, 100.0),
    ("right_if_named", "right if named", ">=", 0.98, 100.0),
    ("truth_in_set", "truth in the answered set", ">=", 0.99, 100.0),
    ("mean_set_size", "mean size of the set", "<=", 2.0, 1.0),
    ("false_alarm", "false alarm without an effect", "<=", 0.05, 100.0),
    ("unknown_wrongly_named", "unknown cause wrongly named", "<=", 0.02, 100.0),
    ("parameter_error_median", "parameter error, median", "<=", 0.02, 100.0),
    ("parameter_error_p90", "parameter error, 90 % below", "<=", 0.10, 100.0),
    ("coverage_95", "95 % intervals that cover the truth", "90-98 %", 0.90, 100.0),
    ("seconds_per_case", "run time of a case [s]", "<=", 5.0, 1.0),
)
"""Key of the aggregate, words, what is asked for, the figure, factor to what is shown."""
_COVERAGE_MOST: Final = 0.98


@record
class Scored(Workers, Shown):
    """How a benchmark is run, and where its score goes."""

    output: Path | None = option("-o/--output FILE", "Write the JSON there as well.")

    def __post_init__(self) -> None:
        """Try the output, before hours of work.

        Raises:
            InputError: it can't be written.
        """
        if self.output is not None:
            _try_to_write(self.output)

    def score(
        self,
        name: str,
        run: Callable[..., Any],
        cases: int,
        seed: int,
        show: Callable[[Mapping[str, Any], int], None],
    ) -> None:
        """Run a benchmark with a progress bar; write its JSON, print its score.

        Without a terminal each finished case is a line, if there is an output.

        Args:
            name: of the benchmark.
            run: (cases, seed, workers, progress, stop, kept) to a BenchmarkResult.
            cases: how many.
            seed: of all random draws.
            show: prints aggregate and number of cases.

        Raises:
            typer.Exit: stopped by a signal; with an output, the scores so far are kept beside it.
            InputError: the output can't be written any more.
        """
        from tombo_benchmarks.cli.journal import Journal
        from tombo_bringup.cli.progress import progress_bar
        from tombo_flight.json_text import as_json as to_json
        from tombo_flight.process.stop_signals import StopSignals
        from tombo_flight.process.workers import process_count

        workers = process_count(self.workers)
        part = None if self.output is None else self.output.with_name(f"{self.output.name}.part")
        kept = None if part is None else Journal(part, f"{name} --seed {seed}")
        with StopSignals() as stop:
            with progress_bar() as bar:

                def on_progress(stage: str, share: float) -> None:
                    bar(stage, share)
                    if part is not None and not sys.stderr.isatty():
                        typer.echo(stage, err=True)  # a run of hours in the background

                result = run(cases, seed, workers, on_progress, stop.asked, kept)
            if stop.asked():
                more = (
                    f"; the same command goes on with '{part}'" if part and part.exists() else ""
                )
                typer.echo(f"Error: interrupted{more}", err=True)
                raise typer.Exit(stop.exit_code)
        text = to_json({"cases": result.cases, "aggregate": result.aggregate})
        if self.output is not None and part is not None:
            write_file(self.output, text)
            part.unlink(missing_ok=True)
        if self.as_json:
            typer.echo(text, nl=False)
            return
        show(result.aggregate, len(result.cases))
        if self.output is not None:
            typer.echo(f"Wrote {self.output}")


@record
class DrawnCases(Scored, Draw):
    """A benchmark of cases that are drawn."""

    cases: int | None = option(
        "--cases N",
        "How many cases. Default: 100; foreign 60, stand and why 200, faults 1000.",
        bounds=(1, _MOST_CASES),
    )

    def score_drawn(
        self,
        name: str,
        run: Callable[..., Any],
        usual: int,
        show: Callable[[Mapping[str, Any], int], None],
    ) -> None:
        """Do the same as `score`, with `usual` cases where no number is given."""
        cases = usual if self.cases is None else self.cases
        self.score(name, run, cases, self.seed or 0, show)


def print_benchmark(aggregate: Mapping[str, Any], cases: int) -> None:
    """Print the score against what is asked for; sets of cases on their own one by one."""
    from tombo_bringup.cli.tables import print_table

    print_table(_table(aggregate, f"{cases} synthetic cases"))
    for name, part in aggregate.items():
        if isinstance(part, Mapping) and any(key in part for key, *_ in THRESHOLDS):
            print_table(_table(part, name.replace("_", " ")))


def _table(aggregate: Mapping[str, Any], title: str) -> Table:
    rows = []
    for key, words, sign, limit, factor in THRESHOLDS:
        value = aggregate.get(key)
        asked = sign if sign not in (">=", "<=") else f"{sign} {_shown(limit, factor)}"
        good = meets(key, value)
        mark = Cell("–") if good is None else Cell("yes" if good else "no", "" if good else "bad")
        rows.append((words, "–" if value is None else _shown(value, factor), asked, mark))
    return Table(("", "found", "asked for", ""), rows, title=title)


def meets(key: str, value: float | None) -> bool | None:
    """Return whether a figure of the aggregate is as asked for; None: there is none."""
    if value is None or value != value:
        return None
    if key == "coverage_95":
        return 0.90 <= value <= _COVERAGE_MOST
    sign, limit = next((sign, limit) for name, _, sign, limit, _ in THRESHOLDS if name == key)
    return value >= limit if sign == ">=" else value <= limit


def _shown(value: float, factor: float) -> str:
    return f"{factor * value:.1f} %" if factor == 100.0 else f"{value:.2f}"


def _try_to_write(path: Path) -> None:
    """Try it, before hours of work: permissions alone do not tell (/proc, a full disk)."""
    there = path.exists()
    try:
        with path.open("ab"):
            pass
        if not there:
            path.unlink()
    except OSError as error:
        raise unwritable(path, error) from error

"""What the commands of `tombo benchmark` share: options, and the way from them to a score."""

from __future__ import annotations

import json
import os
from collections import UserDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from tombo_bringup.cli.options import integer_option, json_option
from tombo_bringup.cli.result_files import unwritable, write_file
from tombo_dynamics.errors import InputError, shown

EXIT_CODES: Final = (
    "Exit code: 0 whatever the score; 2 for bad input or output that can't be written; 130 after "
    "Ctrl-C."
)
_MOST_CASES: Final = 100_000
_MOST_WORKERS: Final = 1024

Cases = Annotated[int, integer_option("--cases N", "How many cases.")]
Workers = Annotated[int | None, integer_option("--workers W", "Processes. Default: one a core.")]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", help="Write the JSON there as well."),
]
AsJson = Annotated[bool, json_option("Print cases and aggregate as JSON, and nothing else.")]


def checked(cases: int, workers: int | None, output: Path | None) -> int:
    """Return how many processes to use.

    Raises:
        InputError: an option is out of bounds, or the output can't be written.
    """
    count = (os.cpu_count() or 1) if workers is None else workers
    for name, value, most in (
        ("--cases", cases, _MOST_CASES),
        ("--workers", count, _MOST_WORKERS),
    ):
        if not 1 <= value <= most:
            raise InputError(f"{name} {value}: out of bounds; accepted: 1 to {most}")
    if output is not None:
        _try_to_write(output)
    return count


def run_and_print(
    name: str,
    run: Callable[..., Any],
    cases: int,
    seed: int,
    workers: int,
    output: Path | None,
    as_json: bool,
    show: Callable[[Mapping[str, Any], int], None],
) -> None:
    """Run a benchmark with a progress bar; write its JSON, print its score.

    Args:
        name: of the benchmark.
        run: (cases, seed, workers, progress, stop, kept) to a BenchmarkResult.
        cases: how many.
        seed: of all random draws.
        workers: processes.
        output: of the JSON.
        as_json: print that, and nothing else.
        show: prints aggregate and number of cases.

    Raises:
        typer.Exit: stopped by a signal; with an output, the scores so far are kept beside it.
        InputError: the output can't be written any more.
    """
    from tombo_bringup.cli.progress import progress_bar
    from tombo_flight.flight_output import as_json as to_json
    from tombo_flight.process.stop_signals import StopSignals

    part = None if output is None else output.with_name(f"{output.name}.part")
    kept = None if part is None else PartFile(part, f"{name} --seed {seed}")
    with StopSignals() as stop:
        with progress_bar() as on_progress:
            result = run(cases, seed, workers, on_progress, stop.asked, kept)
        if stop.asked():
            more = f"; the same command goes on with '{part}'" if part and part.exists() else ""
            typer.echo(f"Error: interrupted{more}", err=True)
            raise typer.Exit(stop.exit_code)
    text = to_json({"cases": result.cases, "aggregate": result.aggregate})
    if output is not None and part is not None:
        write_file(output, text)
        part.unlink(missing_ok=True)
    if as_json:
        typer.echo(text, nl=False)
        return
    show(result.aggregate, len(result.cases))
    if output is not None:
        typer.echo(f"Wrote {output}")


class PartFile(UserDict[int, dict[str, Any]]):
    """Scores of a benchmark by number, one a line of a file; a line cut by a kill is left out."""

    def __init__(self, path: Path, run: str) -> None:
        """Read what is there.

        Args:
            path: the file, made with the first score.
            run: command and seed that the scores are of.

        Raises:
            InputError: it is of another run, or can't be read.
        """
        super().__init__()
        self.path = path
        self._run = run
        try:
            lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"'{path}' can't be read: {error}") from error
        for line in lines:
            try:
                kept_run, number, row = json.loads(line)
            except (ValueError, TypeError):
                continue
            if kept_run != run:
                raise InputError(
                    f"'{path}' is of {shown(kept_run)}, this is {shown(run)}; accepted: the same "
                    "command and seed, or another -o"
                )
            self.data[number] = row

    def __setitem__(self, number: int, row: dict[str, Any]) -> None:
        """Append a score.

        Raises:
            InputError: it can't be written.
        """
        text = json.dumps([self._run, number, row], default=_number)
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write("\n" + text)  # a line that a kill has cut ends here
        except OSError as error:
            raise unwritable(self.path, error) from error
        self.data[number] = row


def _number(value: Any) -> Any:
    """Return a number or list of numpy as Python's own."""
    return value.tolist()


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

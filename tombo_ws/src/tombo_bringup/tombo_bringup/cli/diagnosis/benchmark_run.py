"""What the commands of `tombo benchmark` share: options, and the way from them to a score."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from tombo_bringup.cli.options import integer_option, json_option
from tombo_bringup.cli.part_file import PartFile
from tombo_bringup.cli.result_files import unwritable, write_file
from tombo_dynamics.errors import InputError

EXIT_CODES: Final = (
    "Exit code: 0 whatever the score; 2 for bad input or output that can't be written; 130 after "
    "Ctrl-C."
)
_MOST_CASES: Final = 100_000

Cases = Annotated[int, integer_option("--cases N", "How many cases.")]
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
    if not 1 <= cases <= _MOST_CASES:
        raise InputError(f"--cases {cases}: out of bounds; accepted: 1 to {_MOST_CASES}")
    if output is not None:
        _try_to_write(output)
    from tombo_flight.process.process_pool import process_count

    return process_count(workers)


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

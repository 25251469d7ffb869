"""For commands that compute something and may write a folder of results."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

if TYPE_CHECKING:
    from tombo_bringup.cli.options import Results
    from tombo_flight.process.output_folder import OutputFolder
    from tombo_flight.progress import ProgressCallback
    from tombo_flight.report.page import Page
    from tombo_flight.sweep.study import SweepStudy

_Result = TypeVar("_Result")
YAML = (".yaml", ".yml")


@dataclass(frozen=True)
class Place:
    """Where the results of a run go."""

    path: Path
    replace: bool = False
    """Results that are there may be replaced."""
    numbered: bool = False
    """It is a new folder, with a number where the name is taken."""

    def open(self, *files: str) -> AbstractContextManager[OutputFolder]:
        """Prepare the folder for files, or for those of a flight; see `open_output`."""
        from tombo_flight.process.output_folder import RESULT_FILES, open_output

        names = files or RESULT_FILES
        return open_output(self.path, replace=self.replace, results=names, numbered=self.numbered)


def new_run(name: str) -> Place:
    """Return a new folder under runs/, with a number where the name is taken."""
    return Place(Path("runs") / name, numbered=True)


def plain_name(name: str, nameless: str = "log") -> str:
    """Return a name for a file, which can't lead out of its folder.

    Characters other than letters, digits, dot, plus and minus become _; an empty name `nameless`.
    """
    return (re.sub(r"[^\w.+-]+", "_", name).lstrip(".") or nameless)[:100]


def check_new_file(path: Path, force: bool = False, suffixes: Sequence[str] = ()) -> None:
    """Refuse a file that would be lost, or with another suffix than the accepted ones.

    Raises:
        InputError: another suffix, a folder, or a file that may not be replaced.
    """
    from tombo_dynamics.errors import InputError

    if suffixes and path.suffix not in suffixes:
        raise InputError(f"'{path}': accepted: a file that ends with {suffixes[0]}")
    if path.is_dir():
        raise InputError(f"'{path}' is a folder; accepted: a file")
    if path.exists() and not force:
        raise InputError(f"'{path}' exists; accepted: another name, or --force")


def publish(
    results: Results,
    name: str | None,
    files: Sequence[str],
    compute: Callable[[ProgressCallback], _Result],
    page: Callable[[_Result, Path | None], Page],
    write: Callable[[OutputFolder, _Result, ProgressCallback], object] | None = None,
) -> tuple[_Result, list[str]]:
    """Compute, write into the folder of -o or a new one under runs/, and show the page.

    Args:
        results: where they go; to a new folder not if only JSON is printed.
        name: of a new folder; None: without -o nothing is written.
        files: all names that may be written.
        compute: takes a callback of progress, returns the result.
        page: of the result, and the folder.
        write: puts it into the folder; by default the page, as JSON or HTML.

    Returns:
        The result, and the names that were written.

    Raises:
        typer.Exit: a signal came.
        InputError: the folder can't be used.
    """
    from tombo_bringup.cli.tables import show_page
    from tombo_flight.process.output_folder import write_whole
    from tombo_flight.report.page import page_html, page_json

    def write_pages(folder: OutputFolder, found: _Result, on_progress: ProgressCallback) -> None:
        for file in files:
            text = page_json if file.endswith(".json") else page_html
            write_whole(folder / file, text(page(found, None)))

    place = None
    if results.output is not None:
        place = Place(Path(results.output), replace=results.force)
    elif name is not None and not results.as_json:
        place = new_run(plain_name(name))
    found, path, written = compute_into(place, files, compute, write or write_pages)
    shown = page(found, path)
    show_page(shown, results.as_json, None if results.as_json else path, written)
    return found, written


def compute_into(
    place: Place | None,
    files: Sequence[str],
    compute: Callable[[ProgressCallback], _Result],
    write: Callable[[OutputFolder, _Result, ProgressCallback], object],
) -> tuple[_Result, Path | None, list[str]]:
    """Compute, with a progress bar, and write; a signal ends it at once, with nothing written.

    Args:
        place: the folder; None: nothing is written.
        files: all names that may be written.
        compute: takes a callback of progress, returns the result.
        write: puts it into the folder, before that is published.

    Returns:
        The result, the folder, and the names that were written.

    Raises:
        typer.Exit: a signal came.
        InputError: the folder can't be used.
    """
    from tombo_bringup.cli.progress import progress_bar
    from tombo_flight.process.stop_signals import Stopped, StopSignals

    with StopSignals() as stop:
        try:
            with progress_bar() as on_progress:
                if place is None:
                    with stop.at_once():
                        return compute(on_progress), None, []
                with place.open(*files) as folder:
                    with stop.at_once():
                        found = compute(on_progress)
                        write(folder, found, on_progress)
                    written = [name for name in files if (folder / name).is_file()]
                    folder.publish()
                return found, folder.path, written
        except Stopped:
            typer.echo("Error: interrupted", err=True)
            raise typer.Exit(stop.exit_code) from None


def run_sweep(
    study: SweepStudy,
    place: Place,
    as_json: bool,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Fly what a sweep's folder lacks, with a progress bar and the time left, and show its page.

    Args:
        study: the flights.
        place: of the results.
        as_json: only JSON is printed.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.

    Raises:
        typer.Exit: a signal came; flights up to then are kept.
        InputError: the folder can't be used, or the scheduler can't be reached.
    """
    from tombo_bringup.cli.progress import progress_bar
    from tombo_bringup.cli.tables import show_page
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.sweep.folder import HEAD, PAGE, TABLE, fly_sweep, open_sweep

    with (
        StopSignals() as stop,
        open_sweep(place.path, study, numbered=place.numbered, again=place.replace) as opened,
        progress_bar() as on_progress,
    ):
        path, before, flights = opened.folder, opened.kept, study.flights
        if before and not as_json:
            typer.echo(f"{path}: {before} of {flights} flights are there already.")

        def tell(kept: int, left_s: float) -> None:
            words = f"{kept} of {flights} flights, {timedelta(seconds=round(left_s))} left"
            on_progress(words, kept / flights)
            import matplotlib.figure  # noqa: F401  # for the page, while the processes fly

        on_progress("loading", 0.0)
        page = fly_sweep(
            opened, workers=workers, scheduler=scheduler, progress=tell, stop=stop.requested
        )
    if page is None:
        words = f"{opened.kept} of {flights} flights are kept; the same command with -o {path}"
        typer.echo(f"Interrupted: {words} goes on.", err=True)
        raise typer.Exit(stop.exit_code)
    shown = replace(page, data={**page.data, "flown": flights - before})
    show_page(shown, as_json, path, (TABLE, PAGE, HEAD))

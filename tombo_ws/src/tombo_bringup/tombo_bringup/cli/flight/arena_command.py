"""`tombo arena`: every reaction against a set of collisions, as one JSON and one page."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tombo_bringup.cli.flight.fly_command import parse_seeds
from tombo_bringup.cli.options import Imports, Workers, json_option, option, output_option
from tombo_bringup.cli.result_files import check_output, unwritable, write_file
from tombo_bringup.cli.tables import show_page
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_flight.arena.study import ArenaPlan
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.process.study_folder import Journal
    from tombo_flight.report.page import Page

app = typer.Typer()

ARENA_EXIT_CODES = (
    "Exit code: 0 when all was flown, whatever became of the vehicles; 2 for bad input or output "
    "that can't be written; 130 after Ctrl-C, 143 after SIGTERM: the same command goes on."
)
_MOST_SEEDS = 10_000
_FLIGHTS = "flights.jsonl"
_RESULTS = "arena.json"
_PAGE = "arena.html"


@app.command(epilog=ARENA_EXIT_CODES)
def arena(
    seeds: Annotated[
        str, option("--seeds A:B", "Each case with seeds A to B-1; the maps with a third of them.")
    ] = "0:30",
    reactions: Annotated[
        str | None,
        option(
            "--reactions A,B",
            "Of `tombo reactions`; policy:FILE flies the network of FILE. Default: all else.",
        ),
    ] = None,
    imports: Imports = None,
    groups: Annotated[
        str | None,
        option(
            "--groups A,B",
            "Of collisions, free, configurations, speed_offset, angle_radius. Default: all.",
        ),
    ] = None,
    clean: Annotated[bool, option("--clean", "Without the disturbances.")] = False,
    workers: Workers = None,
    output: Annotated[
        str | None, output_option("Folder of the results. Default: runs/arena-A-B[-clean].")
    ] = None,
    force: Annotated[
        bool, option("--force", "Fly again what is kept in DIR, as after a change of the code.")
    ] = False,
    as_json: Annotated[bool, json_option("Print arena.json, and nothing else.")] = False,
) -> None:
    """Fly every reaction against a set of collisions and compare them on one page.

    Writes arena.json, arena.html and flights.jsonl, a line a flight. With more seeds, reactions or
    groups the same folder flies only what is missing; so it does when it was stopped or killed.
    """
    from tombo_flight.arena.study import GROUPS, arena_cases, chosen, chosen_reactions, new_plan
    from tombo_flight.process.stop_signals import StopSignals

    range_ = parse_seeds(seeds)
    if len(range_) > _MOST_SEEDS:
        raise InputError(f"--seeds {seeds}: too many; accepted: at most {_MOST_SEEDS}")
    names = chosen_reactions(_listed(reactions), "--reactions")
    within = chosen(_listed(groups), "--groups", GROUPS)
    check_output(output)
    path = Path(output or f"runs/arena-{range_.start}-{range_.stop}{'-clean' if clean else ''}")
    with StopSignals() as stop:
        from tombo_bringup.cli.progress import progress_bar

        with progress_bar() as on_progress:
            on_progress("loading", 0.0)
            kept = _kept(path, force)
            cases = [case for case in arena_cases() if case.group in within]
            plan = new_plan(names, cases, range_, disturbed=not clean)
            code = _fly(plan, kept, workers, stop, on_progress)
            if code:
                typer.echo(f"Error: interrupted; the same command goes on with '{path}'", err=True)
                raise typer.Exit(code)
            page = _write(path, plan, kept, range_, on_progress)
    show_page(page, as_json, None if as_json else path, (_PAGE, _RESULTS, _FLIGHTS))


def _listed(text: str | None) -> list[str] | None:
    """Return the parts of a text with commas."""
    return None if text is None else [part.strip() for part in text.split(",")]


def _kept(path: Path, force: bool) -> Journal:
    """Return the flights that a folder has; make it if there is none.

    Raises:
        InputError: it has other things, or can't be written.
    """
    from tombo_flight.process.study_folder import Journal

    flights = path / _FLIGHTS
    try:
        path.mkdir(parents=True, exist_ok=True)
        if force:
            flights.unlink(missing_ok=True)
        elif not flights.exists() and any(path.iterdir()):
            raise InputError(
                f"-o {path}: it is not empty; accepted: a folder, new, empty or of an arena, or "
                "--force"
            )
        with flights.open("a", encoding="utf-8"):
            pass
    except OSError as error:
        raise unwritable(path, error) from error
    return Journal(flights, "arena")


def _fly(
    plan: ArenaPlan,
    kept: Journal,
    workers: int | None,
    stop: StopSignals,
    on_progress: ProgressCallback,
) -> int:
    """Fly what is missing; return the exit code of a signal, 0 without one."""
    from tombo_flight.arena.study import fly_plan

    fly_plan(plan, kept, workers=workers, progress=_told(on_progress), stop=stop.asked)
    return stop.exit_code


def _told(on_progress: ProgressCallback) -> Callable[[int, int], None]:
    """Return what shows the number of flights and the time left."""
    from tombo_bringup.cli.progress import duration_text

    began = time.monotonic()

    def told(done: int, of: int) -> None:
        left = (time.monotonic() - began) / done * (of - done)
        on_progress(f"{done} of {of} flights, {duration_text(left)} left", done / of)

    return told


def _write(
    path: Path, plan: ArenaPlan, kept: Journal, seeds: range, on_progress: ProgressCallback
) -> Page:
    """Write JSON and page, and return the page."""
    from tombo_flight.arena.page import arena_page
    from tombo_flight.arena.results import arena_results
    from tombo_flight.json_text import plain
    from tombo_flight.report.html import write_page
    from tombo_flight.report.page import page_json

    page = arena_page(plain(arena_results(plan, kept, seeds)), plan, kept)
    on_progress("writing arena.html", 1.0)
    write_file(path / _RESULTS, page_json(page))
    write_page(path / _PAGE, page)
    return page

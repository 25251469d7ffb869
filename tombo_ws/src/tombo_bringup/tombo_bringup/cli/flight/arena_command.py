"""`tombo arena`: every reaction against a set of collisions, as one JSON and one page."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from tombo_bringup.cli.flight.fly_command import parse_seeds
from tombo_bringup.cli.options import Imports, Workers, json_option, option, output_option
from tombo_bringup.cli.result_files import check_output, run_study
from tombo_bringup.cli.tables import show_page
from tombo_dynamics.errors import InputError

app = typer.Typer()

ARENA_EXIT_CODES = (
    "Exit code: 0 when all was flown, whatever became of the vehicles; 2 for bad input or output "
    "that can't be written; 130 after Ctrl-C, 143 after SIGTERM: the same command goes on."
)
_MOST_SEEDS = 10_000
_FILES = ("arena.html", "arena.json", "flights.parquet")


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

    Writes arena.json, arena.html and flights.parquet, a row a flight. With more seeds, reactions
    or groups the same folder flies only what is missing; so it does when it was stopped or killed.
    """
    from tombo_bringup.cli.progress import progress_bar
    from tombo_flight.arena.page import analyse_arena
    from tombo_flight.arena.study import GROUPS, arena_cases, chosen, chosen_reactions, new_arena

    range_ = parse_seeds(seeds)
    if len(range_) > _MOST_SEEDS:
        raise InputError(f"--seeds {seeds}: too many; accepted: at most {_MOST_SEEDS}")
    names = chosen_reactions(_listed(reactions), "--reactions")
    within = chosen(_listed(groups), "--groups", GROUPS)
    check_output(output)
    with progress_bar() as on_progress:
        on_progress("loading", 0.0)
        cases = [case for case in arena_cases() if case.group in within]
        study = new_arena(names, cases, range_, disturbed=not clean)
    default = f"runs/arena-{range_.start}-{range_.stop}{'-clean' if clean else ''}"
    path, _, page = run_study(
        study,
        partial(analyse_arena, study),
        output,
        default,
        as_json,
        workers=workers,
        numbered=False,
        again=force,
    )
    show_page(page, as_json, None if as_json else path, _FILES)


def _listed(text: str | None) -> list[str] | None:
    """Return the parts of a text with commas."""
    return None if text is None else [part.strip() for part in text.split(",")]

"""`tombo sweep`: fly a scenario over a design of settings and seeds, into one table."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated

import typer

from tombo_bringup.cli.flight.fly_command import over_scenario, parse_seeds
from tombo_bringup.cli.options import (
    Disturbed,
    Imports,
    JsonOnly,
    ModelFile,
    OptionRule,
    ReactionName,
    Settings,
    VehicleName,
    Workers,
    check_options,
    integer_option,
    option,
    output_option,
)
from tombo_bringup.cli.result_files import plain_name, run_study
from tombo_bringup.cli.tables import show_page

app = typer.Typer()

SWEEP_EXIT_CODES = (
    "Exit code: 0 when all flights are flown, whatever became of the vehicles; 2 for bad input or "
    "output that can't be written; 130 after Ctrl-C, 143 after SIGTERM: the same command with -o "
    "DIR goes on."
)
MOST_SEEDS = 10**9
_RULES = (OptionRule("--workers and --scheduler", "workers", (), ("scheduler",), "one of them"),)


@app.command(epilog=SWEEP_EXIT_CODES)
def sweep(
    scenario: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="A name of `tombo scenarios`, or a YAML file."),
    ],
    axes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=A:B:STEP|V1,V2...",
            help="What is varied, keys as of --set; ends included. With --design lhs or sobol "
            "also KEY=A:B.",
        ),
    ] = None,
    seeds: Annotated[str, option("--seeds A:B", "Fly each point with seeds A to B-1.")] = "0:1",
    reaction: ReactionName = None,
    disturbances: Disturbed = False,
    design: Annotated[
        str,
        option(
            "--design KIND", "full: all combinations; lhs: Latin hypercube; sobol: Sobol sequence."
        ),
    ] = "full",
    samples: Annotated[
        int, integer_option("--samples N", "Points of --design lhs and sobol.")
    ] = 0,
    imports: Imports = None,
    settings: Settings = None,
    model: ModelFile = None,
    vehicle: VehicleName = None,
    workers: Workers = None,
    scheduler: Annotated[
        str | None,
        option(
            "--scheduler URL", "Fly on the cluster of a Dask scheduler, as in tcp://host:8786."
        ),
    ] = None,
    output: Annotated[
        str | None,
        output_option(
            "Folder of the results: new, empty, or that of the same sweep, which then goes on. "
            "Default: a new one, runs/sweep-SCENARIO, with a number where that is taken."
        ),
    ] = None,
    as_json: JsonOnly = False,
) -> None:
    """Fly a scenario over settings and seeds: flights.parquet, one row a flight, and sweep.html.

    What is flown is on disk at once: killed, the same command with -o DIR goes on, flies nothing
    twice and gives the same table.
    """
    check_options(_RULES, {"workers": workers, "scheduler": scheduler})
    from tombo_flight.sweep.page import analyse_sweep
    from tombo_flight.sweep.study import SweepDesign, new_sweep, parse_axis

    chosen = [*over_scenario(reaction, disturbances=disturbances), *(settings or [])]
    points = SweepDesign(tuple(parse_axis(text) for text in axes or []), design, samples)
    range_ = parse_seeds(seeds, MOST_SEEDS)
    study = new_sweep(scenario, points, range_, tuple(chosen), model, vehicle)
    if scheduler is not None:  # before anything is written
        from tombo_flight.process.workers import check_scheduler

        check_scheduler(scheduler)
    default = f"runs/sweep-{plain_name(study.label, 'scenario')}"
    folder, flown, page = run_study(
        study,
        partial(analyse_sweep, study),
        output,
        default,
        as_json,
        workers=workers,
        scheduler=scheduler,
    )
    data = {"flights": study.flights, "flown": flown, "outcome": page.data["outcome"]}
    files = ("flights.parquet", "sweep.html", "sweep.json")
    show_page(replace(page, data=data), as_json, folder, files)

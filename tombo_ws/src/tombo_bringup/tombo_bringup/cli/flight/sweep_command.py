"""`tombo sweep`: fly a scenario over a design of settings and seeds, into one table."""

from __future__ import annotations

from pathlib import Path
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
from tombo_bringup.cli.result_files import Place, check_output, plain_name, run_sweep

app = typer.Typer()

SWEEP_EXIT_CODES = (
    "Exit code: 0 when all flights are flown, whatever became of the vehicles; 2 for bad input or "
    "output that can't be written; 130 after Ctrl-C, 143 after SIGTERM: the same command with -o "
    "DIR goes on."
)
_RULES = (OptionRule("--workers and --scheduler", "workers", (), ("scheduler",), "one of them"),)


@app.command(epilog=SWEEP_EXIT_CODES)
def sweep(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO[,...]",
            help="Names of `tombo scenarios`, or YAML files, which may have cases in them "
            "(docs/sweep.md); collisions: 11 collisions and a flight without one.",
        ),
    ],
    axes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=A:B:STEP|V1,V2...",
            help="What is varied, keys as of --set; ends included. With --design lhs or sobol "
            "also KEY=A:B, and a distribution of scipy.stats, as in "
            "'vehicle.mass=norm(1.3,0.02)'.",
        ),
    ] = None,
    seeds: Annotated[
        str,
        option(
            "--seeds A:B",
            "Fly each point with seeds A to B-1. With --design lhs or sobol each point has seeds "
            "of its own, from A on.",
        ),
    ] = "0:1",
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
    """Fly scenarios over settings and seeds: crash rates, what decides them, and a table.

    Writes flights.parquet, one row a flight, sweep.html and sweep.json. With reaction.name=A,B the
    reactions are compared; with --design lhs or sobol settings are drawn.

    Batches of flights are on disk at once: killed, the same command with -o DIR goes on, flies
    nothing twice and gives the same table.
    """
    check_options(_RULES, {"workers": workers, "scheduler": scheduler})
    from tombo_flight.sweep.design import SweepDesign, parse_axis
    from tombo_flight.sweep.study import new_sweep

    chosen = [*over_scenario(reaction, disturbances=disturbances), *(settings or [])]
    points = SweepDesign(tuple(parse_axis(text) for text in axes or []), design, samples)
    study = new_sweep(scenario, points, parse_seeds(seeds), chosen, model, vehicle)
    check_output(output)
    default = Path("runs") / f"sweep-{plain_name(scenario, 'scenario')}"
    place = Place(default, numbered=True) if output is None else Place(Path(output))
    run_sweep(study, place, as_json, workers=workers, scheduler=scheduler)

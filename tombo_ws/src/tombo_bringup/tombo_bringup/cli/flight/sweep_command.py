"""`tombo sweep`: fly a scenario over a design of settings and seeds, into one table."""

from __future__ import annotations

from pathlib import Path

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.flight.fly_command import parse_seeds
from tombo_bringup.cli.options import argument, command, option, record
from tombo_bringup.cli.result_files import Place, new_run, plain_name, run_sweep

app = typer.Typer()

SWEEP_EXIT_CODES = (
    "Exit code: 0 when all flights are flown, whatever became of the vehicles; 2 for bad input or "
    "output that can't be written; 130 after Ctrl-C, 143 after SIGTERM: the same command with -o "
    "DIR goes on."
)
_RULES: tuple[options.Rule, ...] = (("workers", (), ("scheduler",)),)


@record
class _Sweep:
    scenario: str = argument(
        "SCENARIO[,...]",
        "Names of `tombo list scenarios`, or YAML files, which may have cases in them "
        "(docs/sweep.md); collisions: 11 collisions and a flight without one.",
    )
    axes: list[str] | None = argument(
        "KEY=A:B:STEP|V1,V2...",
        "What is varied, keys as of --set; ends included. With --design lhs or sobol also "
        "KEY=A:B, and a distribution of scipy.stats, as in 'vehicle.mass=norm(1.3,0.02)'.",
        None,
    )
    design: str = option(
        "--design KIND",
        "full: all combinations; lhs: Latin hypercube; sobol: Sobol sequence.",
        "full",
    )
    samples: int = option("--samples N", "Points of --design lhs and sobol.", 0)
    scheduler: str | None = option(
        "--scheduler URL", "Fly on the cluster of a Dask scheduler, as in tcp://host:8786."
    )


@command(app, lab=True, epilog=SWEEP_EXIT_CODES)
def sweep(
    given: _Sweep,
    several: options.Seeds,
    variation: options.Variation,
    workers: options.Workers,
    place: options.Copies,
) -> None:
    """Fly scenarios over settings and seeds: crash rates, what decides them, and a table.

    Writes flights.parquet, one row a flight, sweep.html and sweep.json. With reaction.name=A,B the
    reactions are compared; with --design lhs or sobol settings are drawn.

    Each point is flown with the seeds of --seeds, by default 0 alone; with --design lhs or sobol
    each has seeds of its own, from A on.

    Batches of flights are on disk at once: killed, the same command with -o DIR goes on, flies
    nothing twice and gives the same table.
    """
    options.check_options(_RULES, {**vars(given), **vars(workers)})
    from tombo_flight.sweep.design import SweepDesign, parse_axis
    from tombo_flight.sweep.study import new_sweep

    axes = tuple(parse_axis(text) for text in given.axes or [])
    study = new_sweep(
        given.scenario,
        SweepDesign(axes, given.design, given.samples),
        parse_seeds("0:1" if several.seeds is None else several.seeds),
        variation.changes,
        variation.model,
        variation.vehicle,
    )
    name = f"sweep-{plain_name(given.scenario, 'scenario')}"
    folder = new_run(name) if place.output is None else Place(Path(place.output))
    run_sweep(study, folder, place.as_json, workers=workers.workers, scheduler=given.scheduler)

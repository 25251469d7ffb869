"""`tombo sweep`: fly a scenario over a design of settings and seeds, into one table."""

from __future__ import annotations

import re
from pathlib import Path

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import argument, command, option, record
from tombo_bringup.cli.result_files import Place, plain_name, run_sweep
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import SEED_LIMIT

app = typer.Typer()

SWEEP_EXIT_CODES = (
    "Exit code: 0 when all flights are flown, whatever became of the vehicles; 2 for bad input or "
    "output that can't be written; 130 after Ctrl-C, 143 after SIGTERM: the same command with -o "
    "DIR goes on."
)
_MOST_FLIGHTS = 100_000


@record
class _Sweep:
    scenario: str = argument(
        "SCENARIO[,...]",
        "Names of `tombo list scenarios`, or YAML files, which may have cases in them "
        "(docs/sweep.md); collisions: 11 collisions and a flight without one.",
        "paper_collision",
    )
    axes: list[str] | None = argument(
        "KEY=A:B:STEP|V1,V2...",
        "What is varied, keys as of --set; ends included. With --samples also KEY=A:B, and a "
        "distribution of scipy.stats, as in 'vehicle.mass=norm(1.3,0.02)'.",
        None,
    )
    seeds: str = option("--seeds A:B", "Fly each point with seeds A to B-1.", "0:1")
    samples: int = option(
        "--samples N", "Draw N points (Latin hypercube). Default: all combinations.", 0
    )


@command(app, lab=True, epilog=SWEEP_EXIT_CODES)
def sweep(
    given: _Sweep, variation: options.Variation, workers: options.Workers, place: options.Copies
) -> None:
    """Fly scenarios over settings and seeds: crash rates, and a table of all flights.

    Writes flights.parquet, one row a flight, sweep.html and sweep.json. With reaction.name=A,B the
    reactions are compared.

    Each point is flown with the seeds of --seeds; of --samples each has seeds of its own, from A
    on.

    Batches of flights are on disk at once: killed, the same command with -o DIR goes on, flies
    nothing twice and gives the same table.
    """
    from tombo_flight.sweep.design import SweepDesign, parse_axis
    from tombo_flight.sweep.study import new_sweep

    axes = tuple(parse_axis(text) for text in given.axes or [])
    study = new_sweep(
        given.scenario,
        SweepDesign(axes, given.samples),
        parse_seeds(given.seeds),
        variation.changes,
        variation.model,
        variation.vehicle,
    )
    default = Path("runs") / f"sweep-{plain_name(given.scenario, 'scenario')}"
    folder = Place(default, numbered=True) if place.output is None else Place(Path(place.output))
    run_sweep(study, folder, place.as_json, workers=workers.workers)


def parse_seeds(text: str) -> range:
    """Return the seeds that `A:B` means: A to B-1.

    Raises:
        InputError: not of this form, none, or too many.
    """
    accepted = f"accepted: A:B with 0 <= A < B, at most {_MOST_FLIGHTS} flights, as in 0:100"
    limits = re.fullmatch(r"([0-9]{1,19}):([0-9]{1,19})", text)
    if limits is None:
        raise InputError(f"--seeds {text}: not of the form A:B; {accepted}")
    first, end = int(limits[1]), int(limits[2])
    if first >= end:
        raise InputError(f"--seeds {text}: no seed at all; {accepted}")
    if end - first > _MOST_FLIGHTS or end > SEED_LIMIT:
        raise InputError(f"--seeds {text}: too many; {accepted}")
    return range(first, end)

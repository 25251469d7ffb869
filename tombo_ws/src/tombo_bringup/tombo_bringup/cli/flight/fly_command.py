"""`tombo fly`: one flight with all its files, or many seeds with one table."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.flight.optional_url import PX4_RULES, Px4Options, expand_url_option
from tombo_bringup.cli.options import argument, command, option, record
from tombo_bringup.cli.result_files import Place, new_run, plain_name
from tombo_bringup.cli.tables import show_page
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import SEED_LIMIT

if TYPE_CHECKING:
    from tombo_flight.scenario import Scenario

app = typer.Typer()

EXIT_CODES = (
    "Exit code: 0 when the flight was flown, whatever became of the vehicle (a crash is a "
    "result); 1 when a node ended by itself (--nodes, --px4), or PX4 did not take off or is left "
    "armed; 2 for bad input, a PX4 that can't be reached, or output that can't be written; 130 "
    "after Ctrl-C, 143 after SIGTERM, with what was flown so far in the folder."
)
_MOST_FLIGHTS = 100_000
_RULES: tuple[options.Rule, ...] = (
    ("seed", (), ("seeds",)),
    ("speed", ("nodes",), ("px4", "lockstep")),
    ("lockstep", ("nodes",), ()),
    ("domain", ("nodes", "px4"), ()),
    ("nodes", (), ("seeds", "no_record")),
    ("px4", (), ("nodes", "seeds", "no_record")),
    *PX4_RULES,
)


_SIMULATED = "paper_collision"
_REAL, _REAL_HEIGHT = "hover", "mission.height=0.8"
"""Default scenario of a PX4 at a URL, which may be a real vehicle."""


@record
class _Fly:
    scenario: str | None = argument(
        "[SCENARIO]",
        f"A name of `tombo list scenarios`, or a YAML file. Default: {_SIMULATED}; with --px4 URL "
        f"{_REAL} at 0.8 m.",
        None,
    )
    nodes: bool = option(
        "--nodes", "Fly with the ROS 2 nodes, each a process, in real time.", False
    )
    lockstep: bool = option(
        "--lockstep",
        "With --nodes: the ticks of the headless flight, each answered by all nodes, as fast as "
        "the machine can: the same flight to the last bit.",
        False,
    )
    no_record: bool = option("--no-record", "Write no flight.mcap.", False)


@command(app, lab=True, epilog=EXIT_CODES, expand=expand_url_option)
def fly(
    more: _Fly,
    draw: options.Draw,
    several: options.Seeds,
    variation: options.Variation,
    propeller: options.Propeller,
    px4: Px4Options,
    pace: options.Pace,
    domain: options.Domain,
    force: options.Force,
    place: options.Copies,
) -> None:
    """Fly a scenario and write flight.mcap, summary.json, scenario.yaml, flight.png, report.html.

    With --seeds: flights.parquet, sweep.html and sweep.json, as `tombo sweep` of nothing but
    seeds. Killed, the same command with -o DIR goes on.
    """
    from tombo_flight.scenario import load_scenario

    many = None if several.seeds is None else parse_seeds(several.seeds)
    given = {**vars(draw), **vars(several), **vars(variation), **vars(pace), **vars(domain)}
    options.check_options(_RULES, {**given, **vars(more), **px4.values})
    real = px4.url is not None and more.scenario is None
    seed, scenario = draw.seed or 0, more.scenario or (_REAL if real else _SIMULATED)
    fixed = [*([_REAL_HEIGHT] if real else []), *variation.changes]
    fixed += [f"propeller.{k}={v}" for k, v in vars(propeller).items() if v is not None]
    chosen = load_scenario(scenario, fixed, variation.model, variation.vehicle)
    rest = f"{many.start}-{many.stop}" if many else str(seed)
    rest += "-px4" if px4.px4 is not None else "-nodes" if more.nodes else ""
    if place.output is not None:
        folder = Place(Path(place.output), replace=force.force)
    else:
        folder = new_run(f"{plain_name(chosen.name, 'scenario')}-{rest}")
    if more.nodes or px4.px4 is not None:
        from tombo_bringup.cli.flight.fly_nodes import fly_nodes

        code = fly_nodes(
            chosen,
            seed,
            folder,
            as_json=place.as_json,
            speed=1.0 if pace.speed is None else pace.speed,
            domain=domain.domain,
            lockstep=more.lockstep,
            px4=px4.connection(),
            yes=px4.yes,
        )
    elif many is None:
        code = _fly_one(chosen, seed, folder, not more.no_record, place.as_json)
    else:
        from tombo_bringup.cli.result_files import run_sweep
        from tombo_flight.sweep.design import SweepDesign
        from tombo_flight.sweep.study import new_sweep

        model, vehicle = variation.model, variation.vehicle
        study = new_sweep(scenario, SweepDesign(), many, fixed, model, vehicle)
        run_sweep(study, folder, place.as_json)
        code = 0
    raise typer.Exit(code)


def parse_seeds(text: str, most: int = _MOST_FLIGHTS) -> range:
    """Return the seeds that `A:B` means: A to B-1, `most` of them at most.

    Raises:
        InputError: not of this form, none, or too many.
    """
    found = re.fullmatch(r"([0-9]{1,19}):([0-9]{1,19})", text)
    seeds = range(int(found[1]), int(found[2])) if found else range(0)
    if not 0 < len(seeds) <= most or seeds.stop > SEED_LIMIT:
        raise InputError(
            f"--seeds {text}: accepted: A:B with 0 <= A < B <= {SEED_LIMIT}, at most {most} "
            "flights, as in 0:100"
        )
    return seeds


def _fly_one(scenario: Scenario, seed: int, place: Place, record: bool, as_json: bool) -> int:
    """Rehearse the scenario, fly it, write its files and show its page; return the exit code."""
    from tombo_bringup.cli.progress import progress_bar
    from tombo_flight.flight_output import flown_page, fly_into, warm_up_flight
    from tombo_flight.process.stop_signals import StopSignals

    with progress_bar() as on_progress:
        on_progress("loading", 0.0)
        warm_up_flight(scenario)
        with StopSignals() as stop, place.open() as folder:
            flight = fly_into(folder, scenario, seed, stop, record=record, on_progress=on_progress)
            names = sorted(p.name for p in folder.staging.iterdir())
            folder.publish()
    if not as_json and stop.requested() and not flight.summary["interrupted"]:
        typer.echo("Interrupted after the flight: the pictures are not drawn.")
    show_page(flown_page(flight), as_json, None if as_json else folder.path, names)
    return stop.exit_code

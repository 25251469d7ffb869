"""`tombo fly`: one flight with all its files, or many seeds with one table."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tombo_bringup.cli.errors import print_warnings
from tombo_bringup.cli.flight.optional_url import PX4_RULES, PX4_SPEED, OptionalUrlCommand, url_of
from tombo_bringup.cli.options import (
    BridgeSettings,
    Disturbed,
    Force,
    Imports,
    ModelFile,
    OptionRule,
    Px4Url,
    ReactionName,
    ScenarioArgument,
    SeedOrNone,
    Settings,
    VehicleName,
    Yes,
    check_options,
    integer_option,
    json_option,
    option,
    output_option,
)
from tombo_bringup.cli.result_files import Place, check_output, new_run
from tombo_bringup.cli.tables import show_page
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import SEED_LIMIT

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_flight.process.output_folder import OutputFolder
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.scenario import Scenario

app = typer.Typer()

EXIT_CODES = (
    "Exit code: 0 when the flight was flown, whatever became of the vehicle (a crash is a "
    "result); 1 when a node ended by itself (--nodes, --px4), or PX4 did not take off or is left "
    "armed; 2 for bad input, a PX4 that can't be reached, or output that can't be written; 130 "
    "after Ctrl-C, 143 after SIGTERM, with what was flown so far in the folder."
)
_MOST_FLIGHTS = 100_000
_FIGURES = ("pdf", "svg")
_RULES = (
    OptionRule("--seed {seed} and --seeds {seeds}", "seed", (), ("seeds",), "one of them"),
    PX4_SPEED,
    OptionRule("--speed {speed:g}", "speed", ("nodes",)),
    OptionRule("--lockstep", "lockstep", ("nodes",), ("speed",)),
    OptionRule("--domain {domain}", "domain", ("nodes", "px4")),
    OptionRule("--nodes", "nodes", (), ("seeds", "no_record")),
    OptionRule("--px4", "px4", (), ("nodes", "seeds", "no_record")),
    *PX4_RULES,
    OptionRule("--figure", "figure", (), ("seeds", "nodes", "px4")),
)


@app.command(epilog=EXIT_CODES, cls=OptionalUrlCommand)
def fly(
    scenario: ScenarioArgument = "paper_collision",
    seed: SeedOrNone = None,
    seeds: Annotated[
        str | None,
        option(
            "--seeds A:B",
            "Fly seeds A to B-1 on all cores; one table, no files of single flights.",
        ),
    ] = None,
    reaction: ReactionName = None,
    no_reaction: Annotated[
        bool, option("--no-reaction", "The same as --reaction none: detect, but do nothing.")
    ] = False,
    disturbances: Disturbed = False,
    conf: Annotated[
        int | None,
        integer_option("--conf N", "Propeller configuration of the paper's Table I, 0 to 13."),
    ] = None,
    law: Annotated[
        str | None, option("--law L", "Law of the nodus: published, repaired, consistent.")
    ] = None,
    imports: Imports = None,
    settings: Settings = None,
    model: ModelFile = None,
    vehicle: VehicleName = None,
    nodes: Annotated[
        bool, option("--nodes", "Fly with the ROS 2 nodes, each a process, in real time.")
    ] = False,
    lockstep: Annotated[
        bool,
        option(
            "--lockstep",
            "With --nodes: the ticks of the headless flight, each answered by all nodes, as fast "
            "as the machine can: the same flight to the last bit.",
        ),
    ] = False,
    px4: Px4Url = None,
    yes: Yes = False,
    bridge: BridgeSettings = None,
    speed: Annotated[
        float | None, option("--speed X", "With --nodes: simulated time against real time.")
    ] = None,
    domain: Annotated[
        int | None,
        integer_option(
            "--domain N",
            "With --nodes and --px4: ROS_DOMAIN_ID. Default: one that is free; with --px4 URL "
            "that of the environment, where the motion capture is.",
        ),
    ] = None,
    no_record: Annotated[bool, option("--no-record", "Write no flight.mcap.")] = False,
    figure: Annotated[
        str | None,
        option(
            "--figure FORMAT",
            "Write flight_column.FORMAT too, pdf or svg: the figure as wide as a column of print, "
            "88 mm.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        output_option(
            "Folder of the results, new or empty; with --seeds also that of the same command, "
            "which then goes on. Default: a new one, runs/SCENARIO-SEED with what was changed, "
            "and a number where that is taken."
        ),
    ] = None,
    force: Force = False,
    as_json: Annotated[bool, json_option("Print the summary as JSON, and nothing else.")] = False,
) -> None:
    """Fly a scenario and write flight.mcap, summary.json, scenario.yaml, flight.png, report.html.

    With --seeds: flights.parquet, sweep.html and sweep.json, as `tombo sweep` of nothing but
    seeds. Killed, the same command with -o DIR goes on.
    """
    given = locals()
    from tombo_flight.scenario import load_scenario

    many = None if seeds is None else parse_seeds(seeds)
    check_options(_RULES, {**given, "px4_url": None if px4 is None else url_of(px4)})
    if figure not in (None, *_FIGURES):
        raise unknown_name("--figure", str(figure), _FIGURES)
    if no_reaction:
        if reaction not in (None, "none"):
            raise InputError(f"--reaction {reaction} and --no-reaction: accepted: one of them")
        reaction = "none"
    one = seed or 0
    over = over_scenario(reaction, disturbances=disturbances)
    fixed = [*over, *(settings or []), *_propeller(conf, law)]
    chosen = load_scenario(scenario, fixed, model, vehicle)
    warn_of(chosen)
    check_output(output)
    rest = f"{many.start}-{many.stop}" if many else str(one)
    rest += "-px4" if px4 is not None else "-nodes" if nodes else ""
    if output is not None:
        place = Place(Path(output), replace=force)
    else:
        from tombo_flight.scenario_file import changes

        place = new_run(chosen.name, rest, changes(scenario, chosen, vehicle))
    if nodes or px4 is not None:
        from tombo_bringup.cli.flight.fly_nodes import fly_nodes
        from tombo_flight.suite.px4_connection import px4_connection

        code = fly_nodes(
            chosen,
            one,
            place,
            as_json=as_json,
            speed=1.0 if speed is None else speed,
            domain=domain,
            lockstep=lockstep,
            px4=None if px4 is None else px4_connection(url_of(px4), bridge or []),
            yes=yes,
        )
    elif many is None:
        code = _fly_one(chosen, one, place, not no_record, figure, as_json)
    else:
        from tombo_bringup.cli.result_files import run_sweep
        from tombo_flight.sweep.design import SweepDesign
        from tombo_flight.sweep.study import new_sweep

        study = new_sweep(scenario, SweepDesign(), many, fixed, model, vehicle)
        run_sweep(study, place, as_json)
        code = 0
    raise typer.Exit(code)


def over_scenario(reaction: str | None, *, disturbances: bool) -> list[str]:
    """Return the settings that --reaction and --disturbances mean; those of --set come after.

    Raises:
        InputError: there is no reaction of this name.
    """
    from tombo_collision.reactions import REGISTRY

    if reaction is not None and reaction not in REGISTRY:
        raise unknown_name("--reaction", reaction, REGISTRY)
    named = [] if reaction is None else [f"reaction.name={reaction}"]
    return ["disturbances=true", *named] if disturbances else named


def warn_of(scenario: Scenario) -> None:
    """Say on standard error what a scenario asks for that is hardly meant."""
    from tombo_flight.scenario import scenario_warnings

    print_warnings(scenario_warnings(scenario))


def parse_seeds(text: str, most: int = _MOST_FLIGHTS) -> range:
    """Return the seeds that `A:B` means: A to B-1, `most` of them at most.

    Raises:
        InputError: not of this form, none, or too many.
    """
    accepted = f"accepted: A:B with 0 <= A < B, at most {most} flights, as in 0:100"
    found = re.fullmatch(r"([0-9]{1,19}):([0-9]{1,19})", text)
    if found is None:
        raise InputError(f"--seeds {text}: not of the form A:B; {accepted}")
    first, end = int(found[1]), int(found[2])
    if first >= end:
        raise InputError(f"--seeds {text}: no seed at all; {accepted}")
    if end - first > most or end > SEED_LIMIT:
        raise InputError(f"--seeds {text}: too many; {accepted}")
    return range(first, end)


def _propeller(conf: int | None, law: str | None) -> list[str]:
    """Return the settings that --conf and --law mean; they win over --set.

    Raises:
        InputError: there is no such configuration.
    """
    if conf is not None and not 0 <= conf <= 13:
        raise InputError(f"--conf {conf}: unknown configuration; accepted: 0 (rigid) to 13")
    options = [] if conf is None else [f"propeller.conf={conf}"]
    return options if law is None else [*options, f"propeller.law={law}"]


@contextmanager
def _prepared(
    scenario: Scenario, place: Place
) -> Iterator[tuple[OutputFolder, StopSignals, ProgressCallback]]:
    """Rehearse the scenario, then give folder, signals and progress bar."""
    from tombo_bringup.cli.progress import progress_bar
    from tombo_flight.flight_output import warm_up_flight
    from tombo_flight.process.stop_signals import StopSignals

    with progress_bar() as on_progress:
        on_progress("loading", 0.0)
        warm_up_flight(scenario)
        with StopSignals() as stop, place.open() as folder:
            yield folder, stop, on_progress


def _fly_one(
    scenario: Scenario, seed: int, place: Place, record: bool, figure: str | None, as_json: bool
) -> int:
    from tombo_flight.flight_output import fly_into

    with _prepared(scenario, place) as (folder, stop, on_progress):
        flight = fly_into(
            folder, scenario, seed, stop, record=record, column=figure, on_progress=on_progress
        )
        names = sorted(p.name for p in folder.staging.iterdir())
        folder.publish()
    if not as_json and stop.asked() and not flight.summary["interrupted"]:
        typer.echo("Interrupted after the flight: the pictures are not drawn.")
    show_page(flight.page, as_json, None if as_json else folder.path, names)
    return stop.exit_code

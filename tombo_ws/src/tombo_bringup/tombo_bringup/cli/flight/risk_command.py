"""`tombo risk`: the probability of a crash when settings are uncertain."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from tombo_bringup.cli.flight.fly_command import over_scenario
from tombo_bringup.cli.options import (
    Disturbed,
    Imports,
    JsonOnly,
    ModelFile,
    ReactionName,
    Seed,
    Settings,
    VehicleName,
    Workers,
    integer_option,
    option,
    output_option,
)
from tombo_bringup.cli.result_files import plain_name, run_study
from tombo_bringup.cli.tables import show_page

app = typer.Typer()

RISK_EXIT_CODES = (
    "Exit code: 0 when the flights are flown, whatever the risk is; 2 for bad input, a package "
    "that is not installed or output that can't be written; 130 after Ctrl-C, 143 after SIGTERM: "
    "the same command with -o DIR goes on."
)


@app.command(epilog=RISK_EXIT_CODES)
def risk(
    scenario: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="A name of `tombo scenarios`, or a YAML file."),
    ],
    given: Annotated[
        list[str] | None,
        option(
            "--given KEY~DISTRIBUTION",
            "An uncertain setting, keys as of --set, as in 'vehicle.mass~Normal(1.3,0.02)'; in "
            "quotes. Distributions and their parameters are those of OpenTURNS. KEY alone: "
            "normal, with the tolerance of the vehicle's file or the usual one. May be given "
            "many times.",
        ),
    ] = None,
    flights: Annotated[
        int, integer_option("--flights N", "Flights, those of the search included.")
    ] = 4000,
    method: Annotated[
        str,
        option(
            "--method NAME",
            "adaptive: search crashes, then importance sampling; plain Monte Carlo where crashes "
            "are frequent. monte-carlo: all flights as they come.",
        ),
    ] = "adaptive",
    check: Annotated[
        int | None,
        integer_option(
            "--check N",
            "Then check the estimate by N further flights, drawn as they come: plain Monte Carlo. "
            "Prints both, and whether they agree. With -o DIR of an estimate, or of a shorter "
            "check, what is there is not flown again.",
        ),
    ] = None,
    seed: Seed = 0,
    reaction: ReactionName = None,
    disturbances: Disturbed = False,
    imports: Imports = None,
    settings: Settings = None,
    model: ModelFile = None,
    vehicle: VehicleName = None,
    workers: Workers = None,
    output: Annotated[
        str | None,
        output_option(
            "Folder of the results: new, empty, or that of the same command, which then goes on. "
            "Default: a new one, runs/risk-SCENARIO, with a number where that is taken."
        ),
    ] = None,
    as_json: JsonOnly = False,
) -> None:
    """Say how probable a crash is when settings are uncertain, and what decides it.

    Each flight draws its inputs and its own seed: sensor noise, gusts and scatter are part of the
    risk. Writes risk.html, risk.json and flights.parquet.
    """
    from tombo_flight.risk.page import analyse_risk
    from tombo_flight.risk.study import new_risk

    chosen = [*over_scenario(reaction, disturbances=disturbances), *(settings or [])]
    study = new_risk(scenario, given or [], flights, method, seed, chosen, model, vehicle, check)
    default = f"runs/risk-{plain_name(study.label, 'scenario')}"
    folder, _, page = run_study(
        study, partial(analyse_risk, study), output, default, as_json, workers=workers
    )
    show_page(page, as_json, folder, ("risk.json", "risk.html", "flights.parquet"))

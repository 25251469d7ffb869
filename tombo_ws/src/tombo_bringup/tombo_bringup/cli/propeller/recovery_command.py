"""`tombo propeller recovery`: collisions in a thrust or speed trace and how long each lasts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from tombo_bringup.cli.options import (
    Force,
    UnpackLimit,
    json_option,
    number_option,
    option,
    output_option,
)
from tombo_bringup.cli.result_files import results_folder


def recovery(
    trace: Annotated[
        Path,
        typer.Argument(metavar="TRACE.csv", help="Thrust or speed over time.", show_default=False),
    ],
    column: Annotated[
        str | None, option("--column NAME", "Thrust or speed. Default: by its name.")
    ] = None,
    unit: Annotated[
        str | None,
        option("--unit", "N, mN, gf, kgf, lbf, rpm, rad/s or Hz. Default: by the column's name."),
    ] = None,
    time_column: Annotated[
        str | None, option("--time-column NAME", "Default: by its name.")
    ] = None,
    time_unit: Annotated[
        str | None, option("--time-unit", "s, ms or us. Default: by the column's name, or s.")
    ] = None,
    tare: Annotated[
        float,
        number_option(
            "--tare X",
            "What the unloaded cell reads, in the column's unit.",
            "a number, in the column's unit",
        ),
    ] = 0.0,
    share: Annotated[
        float | None,
        number_option(
            "--share X",
            "Of the level before that counts as recovered. Default: 0.9 of thrust; of speed its "
            "root, 0.949, as thrust goes with speed squared.",
            "0.5 to 0.99",
        ),
    ] = None,
    output: Annotated[
        str | None,
        output_option(
            "Folder of the results. Default: runs/recovery-TRACE, numbered; with --json none."
        ),
    ] = None,
    force: Force = False,
    unpack_limit: UnpackLimit = None,
    as_json: Annotated[bool, json_option("Print recovery.json, and nothing else.")] = False,
) -> None:
    """Find the collisions in a trace, and the time until 90 % of the thrust are back.

    Each comes with a 95 % interval; one that does not recover in the trace comes out as "more
    than". A speed trace gives a lower bound, "at least": a folded blade has less thrust than its
    speed says. Writes recovery.json, recovery.csv and recovery.png. See docs/beta.md.
    """
    from tombo_bringup.cli.tables import show_page
    from tombo_dynamics.errors import InputError
    from tombo_flight.process.output_folder import open_output
    from tombo_propeller.recovery import LEAST_SHARE, MOST_SHARE, SHARE, recoveries
    from tombo_propeller.recovery_page import RECOVERY_FILES, recovery_page, write_recovery
    from tombo_propeller.rotor_trace import read_trace

    if share is not None and not LEAST_SHARE <= share <= MOST_SHARE:
        raise InputError(f"--share {share:g}; accepted: {LEAST_SHARE:g} to {MOST_SHARE:g}")
    read = read_trace(trace, column, unit, time_column, time_unit, tare)
    goal = share if share is not None else math.sqrt(SHARE) if read.is_speed else SHARE
    try:
        collisions = recoveries(read.time, read.value, goal)
    except InputError as error:
        raise InputError(f"'{trace}': {error}") from None
    page = recovery_page(read, collisions, goal)
    path = results_folder(output, "recovery", trace.name.split(".")[0], as_json, "trace")
    if path is not None:
        with open_output(
            path, replace=force, results=RECOVERY_FILES, numbered=output is None
        ) as folder:
            write_recovery(folder.staging, read, collisions, page)
            folder.publish()
        path = folder.path
    show_page(page, as_json, None if as_json else path, RECOVERY_FILES)

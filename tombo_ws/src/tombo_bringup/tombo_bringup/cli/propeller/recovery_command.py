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
    from tombo_dynamics.errors import InputError
    from tombo_flight.process.output_folder import open_output
    from tombo_propeller.flap_video.output import (
        RECOVERY_FILES,
        recovery_csv,
        recovery_json,
        write_text,
    )
    from tombo_propeller.flap_video.trace import read_trace
    from tombo_propeller.recovery import LEAST_SHARE, MOST_SHARE, SHARE, recoveries

    if share is not None and not LEAST_SHARE <= share <= MOST_SHARE:
        raise InputError(f"--share {share:g}; accepted: {LEAST_SHARE:g} to {MOST_SHARE:g}")
    read = read_trace(trace, column, unit, time_column, time_unit, tare)
    goal = share if share is not None else math.sqrt(SHARE) if read.is_speed else SHARE
    try:
        found = recoveries(read.time, read.value, goal)
    except InputError as error:
        raise InputError(f"'{trace}': {error}") from None
    text = recovery_json(found, read, goal)
    path = results_folder(output, "recovery", trace.name.split(".")[0], as_json, "trace")
    if path is not None:
        from tombo_propeller.flap_video.plots import plot_recovery

        with open_output(
            path, replace=force, results=RECOVERY_FILES, numbered=output is None
        ) as folder:
            write_text(folder / "recovery.json", text)
            write_text(folder / "recovery.csv", recovery_csv(found, read))
            plot_recovery(read, found, goal, folder / "recovery.png")
            folder.publish()
        path = folder.path
    if as_json:
        typer.echo(text, nl=False)
        return
    for r in found:
        level = f"{r.level:.0f}" if r.level >= 1000.0 else f"{r.level:.3g}"
        words = r.as_text(lower_bound=read.is_speed)
        typer.echo(
            f"Collision at {r.time:.3f} s, from {level} {read.unit}: recovered after {words}"
        )
    whole = [r.recovered for r in found if not r.why]
    if len(whole) > 1:
        least = "at least " if read.is_speed else ""
        typer.echo(f"Mean of {len(whole)}: {least}{sum(whole) / len(whole):.3f} s")
    if read.is_speed:
        typer.echo(
            "Note: a lower bound, as it is a speed: while a blade is folded, thrust is less than "
            "its speed says."
        )
    for note in read.notes:
        typer.echo(f"Note: {note}.")
    if path is not None:
        typer.echo(f"Results: {path.resolve()}")

"""`tombo propeller recovery`: collisions in a thrust or speed trace and how long each lasts."""

from __future__ import annotations

import math
from pathlib import Path

from tombo_bringup.cli.options import Results, argument, option, record


@record
class _Trace:
    trace: Path = argument("TRACE.csv", "Thrust or speed over time.")
    column: str | None = option("--column NAME", "Thrust or speed. Default: by its name.")
    time_column: str | None = option("--time-column NAME", "Default: by its name.")
    tare: float = option("--tare X", "What the unloaded cell reads, in the column's unit.", 0.0)


def recovery(given: _Trace, results: Results) -> None:
    """Find the collisions in a trace, and the time until 90 % of the thrust are back.

    Each comes with a 95 % interval; one that does not recover in the trace comes out as "more
    than". A speed trace gives a lower bound, "at least": a folded blade has less thrust than its
    speed says. Writes recovery.json and recovery.png. See docs/beta.md.
    """
    from tombo_bringup.cli.result_files import publish
    from tombo_dynamics.errors import InputError
    from tombo_propeller.recovery import SHARE, recoveries
    from tombo_propeller.recovery_page import RECOVERY_FILES, recovery_page, write_recovery
    from tombo_propeller.rotor_trace import read_trace

    trace = given.trace
    read = read_trace(trace, given.column, given.time_column, given.tare)
    goal = math.sqrt(SHARE) if read.is_speed else SHARE  # thrust goes with speed squared
    try:
        collisions = recoveries(read.time, read.value, goal)
    except InputError as error:
        raise InputError(f"'{trace}': {error}") from None
    page = recovery_page(read, collisions, goal)
    publish(
        results,
        f"recovery-{trace.name.split('.')[0]}",
        RECOVERY_FILES,
        lambda on_progress: collisions,
        lambda collisions, folder: page,
        lambda folder, collisions, _: write_recovery(folder.staging, read, collisions, page),
    )

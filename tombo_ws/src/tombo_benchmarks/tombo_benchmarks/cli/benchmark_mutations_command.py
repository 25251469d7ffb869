"""`tombo benchmark mutations`: honest damage to a real log, and whether it is named."""

from __future__ import annotations

import os
from pathlib import Path

from tombo_bringup.cli.options import LogMapping, Shown, VehicleName, argument, option, record


@record
class _Mutations:
    log: Path = argument("LOG", "A sound flight.")
    healthy: list[Path] | None = option(
        "--healthy OLD",
        "Another flight of the vehicle: what has changed since is asked, too. Once for each.",
    )
    way: str | None = option("--way NAME", "Ask in this way only: plain, vehicle or healthy.")


def benchmark_mutations(
    given: _Mutations, known: VehicleName, reading: LogMapping, shown: Shown
) -> None:
    """Damage a log in 22 ways, one at a time, and count how often `tombo diagnose` names it.

    Axes swapped, reversed, scaled, offset; units; motors swapped; samples late, frozen,
    dropped; a body defined turned; commands scaled. The log alone is asked, and with
    --vehicle and --healthy in these ways as well.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_benchmarks.diagnosis.mutations import Reference, ask_all, mutation_page
    from tombo_bringup.cli.progress import progress_bar
    from tombo_bringup.cli.tables import show_page
    from tombo_flight.vehicle_file import read_vehicle
    from tombo_logs.readers.log_reader import read_logs

    with progress_bar() as on_progress:
        flight, *others = read_logs([given.log, *(given.healthy or [])], mapping=reading.mapping)
        file = None if known.vehicle is None else read_vehicle(known.vehicle)
        answers = ask_all(flight, Reference(file, others), given.way, on_progress)
    show_page(mutation_page(flight.name, answers), shown.as_json)

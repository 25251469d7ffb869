"""Many flights: a sweep as one table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from tombo.flights import texts_of
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


def sweep(
    scenario: str,
    axes: Mapping[str, str | Sequence[Any]] | None = None,
    seeds: range = range(1),
    *,
    design: str = "full",
    samples: int = 0,
    reaction: str | None = None,
    settings: Mapping[str, Any] | None = None,
    model: str | None = None,
    vehicle: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    output: str | Path | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> pd.DataFrame:
    """Fly a scenario over a design of settings and seeds: what `tombo sweep` does.

    Args:
        scenario: names of `tombo list scenarios` or YAML files, with commas between them; also
            "collisions", and a file with cases (docs/sweep.md).
        axes: key of a setting → values, or a text as "1.1:1.7:0.1" or, for drawn designs, "1:2" or
            "norm(1.3,0.02)".
        seeds: each point is flown with each of them, of a drawn design with seeds of its own from
            the first on; without a step.
        design: full, lhs (Latin hypercube) or sobol.
        samples: points of the drawn designs.
        reaction: name of the reaction to collisions, in place of the scenario's.
        settings: values of the scenario that are the same in all flights.
        model: a model.yaml, whose effects are merged with those of the scenario.
        vehicle: a name of `tombo vehicle list`, or a vehicle file.
        workers: processes on this machine; all cores if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        output: folder of flights.parquet, sweep.html and sweep.json; a sweep that was interrupted
            in it goes on. None: nothing is left on disk.
        progress: called with the number of flights done and the time left [s].

    Returns:
        One row a flight, sorted: flight, point, seed, case (of more than one), the axes, and the
        figures of its summary (docs/figures.md); a vector has the columns _x, _y and _z. `error`
        says why a flight could not be flown.

    Raises:
        InputError: bad input, or another sweep is in the folder.
    """
    from tombo_flight.sweep.design import SweepDesign, axis_of
    from tombo_flight.sweep.folder import fly_sweep, open_sweep
    from tombo_flight.sweep.study import new_sweep

    if seeds.step != 1:
        raise InputError(f"seeds: {seeds}; accepted: a range with step 1")
    varied = tuple(axis_of(key, values) for key, values in (axes or {}).items())
    fixed = [f"reaction={{name: {reaction}}}"] if reaction else []
    fixed += texts_of(dict(settings or {}))
    study = new_sweep(
        scenario, SweepDesign(varied, design, samples), seeds, tuple(fixed), model, vehicle
    )
    with ExitStack() as stack:
        folder = Path(output or stack.enter_context(TemporaryDirectory(prefix="tombo-")))
        opened = stack.enter_context(open_sweep(folder, study))
        fly_sweep(
            opened,
            workers=workers,
            scheduler=scheduler,
            progress=progress,
            page=output is not None,
        )
        return opened.table()

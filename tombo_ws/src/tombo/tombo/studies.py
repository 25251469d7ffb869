"""Many flights: a sweep as one table, the risk of a crash, reactions compared in an arena."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
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
        scenario: a name of `tombo scenarios`, or a YAML file.
        axes: key of a setting → values, or a text as "1.1:1.7:0.1" or, for drawn designs, "1:2".
        seeds: each point is flown with each of them; without a step.
        design: full, lhs (Latin hypercube) or sobol.
        samples: points of the drawn designs.
        reaction: name of the reaction to collisions, in place of the scenario's.
        settings: values of the scenario that are the same in all flights.
        model: a model.yaml, whose effects are laid over those of the scenario.
        vehicle: a name of `tombo vehicle list`, or a vehicle file.
        workers: processes on this machine; all cores if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        output: folder of flights.parquet and sweep.html; a sweep that was interrupted in it goes
            on. None: nothing is left on disk.
        progress: called with the number of flights done and the time left [s].

    Returns:
        One row a flight, sorted: flight, point, seed, the axes, and the figures of its summary
        (docs/figures.md); a vector has the columns _x, _y and _z. `error` says why a flight could
        not be flown.

    Raises:
        InputError: bad input, or another sweep is in the folder.
    """
    import pyarrow.parquet as pq

    from tombo_flight.process.study_folder import TABLE, fly_study, open_study
    from tombo_flight.sweep.page import analyse_sweep
    from tombo_flight.sweep.study import SweepDesign, axis_of, new_sweep

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
        opened = stack.enter_context(open_study(folder, study))
        fly_study(
            opened,
            partial(analyse_sweep, study),
            workers=workers,
            scheduler=scheduler,
            progress=progress,
            page=output is not None,
        )
        table: pd.DataFrame = pq.read_table(folder / TABLE).to_pandas()
    return table


def risk(
    scenario: str,
    given: Sequence[str] = (),
    flights: int = 4000,
    *,
    method: str = "adaptive",
    check: int | None = None,
    seed: int = 0,
    reaction: str | None = None,
    settings: Mapping[str, Any] | None = None,
    model: str | None = None,
    vehicle: str | None = None,
    workers: int | None = None,
    output: str | Path | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> dict[str, Any]:
    """Say how probable a crash is when settings are uncertain: what `tombo risk` does.

    Args:
        scenario: a name of `tombo scenarios`, or a YAML file.
        given: uncertain settings, as "vehicle.mass~Normal(1.3,0.02)"; a key alone has its usual
            tolerance.
        flights: those of the search included.
        method: adaptive or monte-carlo.
        check: further flights, drawn as they come, by which the estimate is checked.
        seed: all draws follow from it.
        reaction: name of the reaction to collisions, in place of the scenario's.
        settings: values of the scenario that are the same in all flights.
        model: a model.yaml, whose effects are laid over those of the scenario.
        vehicle: a name of `tombo vehicle list`, or a vehicle file.
        workers: processes; all cores if None.
        output: folder of risk.html, risk.json and flights.parquet; a study that was interrupted in
            it goes on. None: nothing is left on disk.
        progress: called with the number of flights done and the time left [s].

    Returns:
        probability (None: no crash was found), low, high, flights, and more (docs/risk.md).

    Raises:
        InputError: bad input, a package that is not installed, or another study in the folder.
    """
    from tombo_flight.process.study_folder import fly_study, open_study
    from tombo_flight.risk.page import analyse_risk
    from tombo_flight.risk.study import new_risk

    fixed = [f"reaction={{name: {reaction}}}"] if reaction else []
    fixed += texts_of(dict(settings or {}))
    study = new_risk(scenario, given, flights, method, seed, fixed, model, vehicle, check)
    with ExitStack() as stack:
        folder = Path(output or stack.enter_context(TemporaryDirectory(prefix="tombo-")))
        opened = stack.enter_context(open_study(folder, study))
        page = fly_study(
            opened,
            partial(analyse_risk, study),
            workers=workers,
            progress=progress,
            page=output is not None,
        )
    assert page is not None  # nothing asks it to stop
    return dict(page.data)


def arena(
    seeds: range = range(30),
    reactions: Sequence[str] | None = None,
    groups: Sequence[str] | None = None,
    *,
    clean: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Fly reactions against a set of collisions: what `tombo arena` does, without its files.

    Args:
        seeds: each case is flown with each of them, the maps with a third; without a step.
        reactions: names, your own too (`tombo.import_reactions`); policy:FILE flies the network of
            FILE. None: all that are compared.
        groups: of collisions, free, configurations, speed_offset, angle_radius. None: all.
        clean: without the disturbances.
        workers: processes on this machine; all cores if None.
        progress: called with the number of flights done, and of all.

    Returns:
        What `arena.json` says: `results` has a row for each reaction in each case, for
        `pandas.DataFrame`; `refused` says what could not be flown, and why.

    Raises:
        InputError: an unknown name, a policy without a network, or no seeds.
    """
    from tombo_flight.arena.results import arena_results
    from tombo_flight.arena.study import GROUPS, arena_cases, chosen, chosen_reactions, new_arena
    from tombo_flight.json_text import plain
    from tombo_flight.process.study import Flown, fly_tasks

    if not seeds or seeds.step != 1 or seeds.start < 0:
        raise InputError(f"seeds: {seeds}; accepted: a range from 0 or more with step 1")
    names = chosen_reactions(reactions, "reactions")
    within = chosen(groups, "groups", GROUPS)
    cases = [case for case in arena_cases() if case.group in within]
    study = new_arena(names, cases, seeds, disturbed=not clean)
    rows: dict[str, dict[str, Any]] = {}

    def keep(flown: Flown) -> None:
        rows.update({task.key: {"seed": task.seed, **row} for task, row in flown})
        if progress is not None:
            progress(len(rows), len(study.tasks))

    fly_tasks(study, study.tasks, len(study.tasks), keep, workers=workers)
    results: dict[str, Any] = plain(arena_results(study, rows))
    return results

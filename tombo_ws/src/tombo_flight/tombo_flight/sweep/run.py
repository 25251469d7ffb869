"""Flies a sweep into its folder: what is missing, the table, the page."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from tombo_dynamics.errors import InputError
from tombo_flight.flight_output import warm_up_flight
from tombo_flight.process.study import Progress, Row, Task, fly_tasks, pace
from tombo_flight.sweep.store import PAGE, TABLE, Store, write_outcome


def fly_sweep(
    store: Store,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    page: bool = True,
) -> str | None:
    """Fly the flights that the store does not have, and write table and page.

    Args:
        store: where they go.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        progress: told the progress.
        stop: asked now and then; True ends it, with what was flown on disk.
        page: write the page.

    Returns:
        How the flights ended, in one line, empty without a page; None: it was stopped.

    Raises:
        InputError: the scheduler can't be reached, or has another version of the suite.
        OSError: the folder can't be written.
    """
    sweep = store.sweep
    if not store.finished:
        if scheduler is None:
            with suppress(InputError):  # a flight that can't be flown says so in its row
                warm_up_flight(sweep.scenario_at(0))  # once, not in each process
        tell = pace(progress, lambda: store.kept, sweep.flights)

        def keep(task: Task, row: Row) -> None:
            place = {"flight": task.key, "point": task.point, "seed": task.seed}
            store.keep({**place, **sweep.points[task.point], **row})
            tell()

        tasks = (Task(flight, *sweep.place(flight)) for flight in store.missing())
        missing = sweep.flights - store.kept
        fly_tasks(sweep, tasks, missing, keep, workers=workers, scheduler=scheduler, stop=stop)
        if store.kept < sweep.flights:
            return None
        store.finish()
    if not page:
        return ""
    from tombo_flight.sweep.page import write_page

    outcome = write_page(store.folder / PAGE, store.folder / TABLE, sweep)
    write_outcome(store.folder, sweep, outcome)
    return outcome

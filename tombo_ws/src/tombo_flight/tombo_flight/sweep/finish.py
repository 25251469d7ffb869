"""A sweep from beginning to end: what is missing, the table, the page."""

from __future__ import annotations

from collections.abc import Callable

from tombo_flight.sweep.run import Progress, fly_missing
from tombo_flight.sweep.store import PAGE, TABLE, Store, write_outcome


def fly_sweep(
    store: Store,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
) -> str | None:
    """Fly what is missing and write table and page; arguments and errors as of `fly_missing`.

    Returns:
        How the flights ended, in one line; None: it was stopped.
    """
    whole = fly_missing(store, workers=workers, scheduler=scheduler, progress=progress, stop=stop)
    if not whole:
        return None
    from tombo_flight.sweep.page import write_page

    outcome = write_page(store.folder / PAGE, store.folder / TABLE, store.study)
    write_outcome(store.folder, store.study, outcome)
    return outcome

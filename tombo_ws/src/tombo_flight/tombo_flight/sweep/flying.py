"""Fly a sweep, and write its table, its result and its page."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from tombo_flight.process.study import Flown, fly_tasks
from tombo_flight.sweep.folder import PAGE, SweepFolder

if TYPE_CHECKING:
    from tombo_flight.report.page import Page

Progress = Callable[[int, float], None]
"""Called with the number of flights that are on disk, and the time left [s]."""


def fly_sweep(
    opened: SweepFolder,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    page: bool = True,
) -> Page | None:
    """Fly what a sweep's folder does not have, and write table, page and result.

    Args:
        opened: the folder.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        progress: told the progress.
        stop: asked now and then; True ends it, with the finished flights on disk.
        page: make page and result, too.

    Returns:
        The page; None: it was stopped, or there is none.

    Raises:
        InputError: the scheduler can't be reached.
        OSError: the folder can't be written.
    """
    study, began, before = opened.study, time.monotonic(), opened.kept

    def keep(flown: Flown) -> None:
        opened.keep(flown)
        if progress is not None:
            rate = (opened.kept - before) / max(time.monotonic() - began, 1e-6)
            progress(opened.kept, (study.flights - opened.kept) / rate)

    fly_tasks(
        study,
        opened.missing(),
        study.flights - before,
        keep,
        workers=workers,
        scheduler=scheduler,
        stop=stop,
    )
    if opened.kept < study.flights:
        return None
    opened.finish()
    if not page:
        return None
    from tombo_flight.report.html import write_page
    from tombo_flight.sweep.page import sweep_page

    made = sweep_page(opened)
    write_page(opened.folder / PAGE, made)
    opened.write_head(made.data)
    return made

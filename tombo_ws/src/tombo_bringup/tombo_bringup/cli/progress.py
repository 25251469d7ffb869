"""Progress on standard error: a bar, on a terminal only."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tombo_flight.progress import ProgressCallback

_REFRESH_S = 0.1


@contextmanager
def progress_bar() -> Iterator[ProgressCallback]:
    """Show stage and share while within the context; no thread, so it takes no time from a flight.

    The bar is gone at the end.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    progress = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
        auto_refresh=False,
    )
    task = progress.add_task("", total=1.0)
    shown, when = "", 0.0

    def on_progress(stage: str, share: float) -> None:
        nonlocal shown, when
        now = time.monotonic()
        if stage == shown and now - when < _REFRESH_S:
            return
        shown, when = stage, now
        progress.update(task, description=stage, completed=min(share, 1.0), refresh=True)

    with progress:
        yield on_progress

"""Progress on standard error: a bar on a terminal, elsewhere a line every ten seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tombo_flight.progress import ProgressCallback

_REFRESH_S = 0.1
_LINE_S = 10.0
"""Time between two lines, and before the first."""


@contextmanager
def progress_bar() -> Iterator[ProgressCallback]:
    """Show stage and share while within the context; no thread, so it takes no time from a flight.

    The bar is gone at the end.
    """
    if not sys.stderr.isatty():
        yield _lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    progress = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
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


def _lines() -> ProgressCallback:
    due = time.monotonic() + _LINE_S

    def on_progress(stage: str, share: float) -> None:
        nonlocal due
        if (now := time.monotonic()) >= due:
            due = now + _LINE_S
            print(f"{stage}, {min(share, 1.0):.0%}", file=sys.stderr, flush=True)

    return on_progress

"""How long work tells its progress."""

from __future__ import annotations

from collections.abc import Callable

ProgressCallback = Callable[[str, float], None]
"""Called with the present step, and the finished share from 0 to 1."""


def no_progress(stage: str, share: float) -> None:
    """Tell nothing."""

"""Ctrl-C and SIGTERM as requests to stop: the flight ends, and its data are kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_WATCHED = (signal.SIGINT, signal.SIGTERM)


class Stopped(Exception):
    """Raised inside `StopSignals.at_once` when a signal comes."""


class StopSignals:
    """Within this context the first signal is remembered; the second one ends the work at once.

    Outside of the main thread, where Python allows no handlers, it watches nothing.
    """

    def __init__(self, *more: signal.Signals) -> None:
        """Prepare to watch for SIGINT, SIGTERM and `more`."""
        self._watched = (*_WATCHED, *more)
        self.number = 0
        """The signal that came first; 0: none."""
        self._raising = False
        self._before: dict[signal.Signals, Any] = {}

    def requested(self) -> bool:
        """Return whether a signal has requested a stop."""
        return self.number != 0

    @property
    def exit_code(self) -> int:
        """Exit code that a shell expects of a process ended by the signal; 0 without one."""
        return 128 + self.number if self.number else 0

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Within this context a signal, also one that has come before, raises `Stopped`.

        Where that is swallowed, as exceptions in callbacks are, it is raised at the end.
        """
        self._raising = True
        try:
            if self.requested():
                raise Stopped
            yield
            if self.requested():
                raise Stopped
        finally:
            self._raising = False

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            if number == signal.SIGHUP:  # a closed terminal sends it more than once
                return
            raise KeyboardInterrupt
        self.number = number
        if self._raising:
            raise Stopped

    def __enter__(self) -> StopSignals:
        """Watch for signals."""
        if threading.current_thread() is threading.main_thread():
            for watched in self._watched:
                self._before[watched] = signal.signal(watched, self._receive)
        return self

    def __exit__(self, *error: object) -> None:
        """Restore the signal handlers.

        Except SIGHUP if that ended it: a second one must not kill the clean-up.
        """
        for watched, handler in self._before.items():
            again = watched == signal.SIGHUP == self.number
            signal.signal(watched, signal.SIG_IGN if again else handler)

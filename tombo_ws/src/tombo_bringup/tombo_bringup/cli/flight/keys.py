"""Keys of `tombo up`: the operator's requests, each by a key."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
import tty
from types import TracebackType
from typing import Any

REQUESTS = {"h": "hold", "l": "land", "k": "kill"}
"""Key → request to the monitor, which passes it to the nodes (`tombo_ros.operator_requests`)."""
HELP = "keys: h hold, l land, kk kill (rotors off at once)"
_TWICE_S = 1.0
"""Two strokes of the key that switches the rotors off count within this time."""


class Keys:
    """Reads single keys while the terminal is ours; without a terminal there are none.

    Use as a context manager: leaving it gives the terminal back as it was.
    """

    def __init__(self) -> None:
        try:
            self._fd = sys.stdin.fileno()
        except (AttributeError, OSError, ValueError):  # closed, or no file at all
            self._fd = -1
        self._before: list[Any] | None = None
        self._armed_s = -_TWICE_S

    def __enter__(self) -> Keys:
        """Take keys without Return and without echo; Ctrl-C stays a signal."""
        if self._is_ours():
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the terminal."""
        if self._before is not None and self._is_ours():
            with contextlib.suppress(termios.error):  # it was closed meanwhile
                termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)

    @property
    def there(self) -> bool:
        """Whether keys are read."""
        return self._before is not None

    def requests(self) -> list[str]:
        """Return the requests since the last call: `hold`, `land`, `kill`, or `kill?`.

        `kill?` is the first of the two strokes that it takes.
        """
        if not self.there or not self._is_ours():  # in the background reading would stop us
            return []
        ready, _, _ = select.select([self._fd], [], [], 0.0)
        pressed = os.read(self._fd, 64).decode("utf-8", "replace") if ready else ""
        return [asked for key in pressed if (asked := self._request(key))]

    def _request(self, key: str) -> str:
        request = REQUESTS.get(key.lower(), "")
        if request != "kill":
            return request
        now_s = time.monotonic()
        again = now_s - self._armed_s < _TWICE_S
        self._armed_s = -_TWICE_S if again else now_s
        return "kill" if again else "kill?"

    def _is_ours(self) -> bool:
        try:
            return os.isatty(self._fd) and os.tcgetpgrp(self._fd) == os.getpgrp()
        except OSError:
            return False

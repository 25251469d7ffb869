"""Ends the nodes of a supervisor that was killed.

    python -I -S guard.py < PIPE

Reads process groups from the supervisor's pipe: a line `PID` adds a group, `-PID` removes it.
When the pipe closes, the nodes have got their SIGINT (see `launcher`). Groups that still run 2 s
later get SIGTERM, then SIGKILL.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time

_STEPS = ((2.0, signal.SIGTERM), (0.5, signal.SIGKILL))
"""Time to wait [s], and the signal that running nodes get then."""
_LOOK_S = 0.05


def _alive(groups: set[int]) -> bool:
    """Return whether any process of these groups has not ended; unreaped ones have."""
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                with open(f"/proc/{name}/stat", encoding="utf-8", errors="replace") as file:
                    state, _, group = file.read().rpartition(")")[2].split()[:3]
            except (OSError, ValueError):
                continue
            if state not in "ZX" and int(group) in groups:
                return True
    return False


def main() -> None:
    """Follow the supervisor to its end, then clean up."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    for line in sys.stdin:
        group = int(line)
        if group > 0:
            groups.add(group)
        else:
            groups.discard(-group)
    for wait_s, number in _STEPS:
        end = time.monotonic() + wait_s
        while time.monotonic() < end and _alive(groups):
            time.sleep(_LOOK_S)
        for group in groups:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(group, number)


if __name__ == "__main__":
    main()

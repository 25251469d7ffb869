"""Starts a node so that it ends when its supervisor does.

    python -I -S launcher.py SUPERVISOR_PID GUARD_FD COMMAND [ARGUMENT ...]

Run as a file, in a session of its own: it tells the guard its process group, asks the kernel for
SIGINT at the supervisor's death, and turns into COMMAND.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main(arguments: list[str]) -> None:
    """Register, arrange, become."""
    supervisor, guard, command = int(arguments[0]), int(arguments[1]), arguments[2:]
    with contextlib.suppress(OSError):  # no guard any more: the kernel's arrangement is enough
        os.write(guard, f"{os.getpid()}\n".encode())
    os.set_inheritable(guard, False)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT, 0, 0, 0)
    if os.getppid() != supervisor:  # it died before the arrangement
        return
    os.execv(command[0], command)


if __name__ == "__main__":
    main(sys.argv[1:])

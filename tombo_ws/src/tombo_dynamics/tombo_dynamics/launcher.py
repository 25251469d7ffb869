"""Ends a process when its parent ends; as a file, starts a node of a supervisor so.

    python -I -S launcher.py SUPERVISOR_PID GUARD_FD COMMAND [ARGUMENT ...]

As a file it runs in a session of its own. It writes its process group to the guard, asks the
kernel for SIGINT at the supervisor's death, and executes COMMAND. It imports the standard library
alone, so a node starts at once.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int, signal_number: int) -> bool:
    """Ask the kernel for a signal at the parent's death; return whether the parent still lives.

    Args:
        parent: its process id.
        signal_number: the signal that this process then receives.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal_number, 0, 0, 0)
    return os.getppid() == parent


def main(arguments: list[str]) -> None:
    """Register at the guard, request the signal, and execute the command."""
    supervisor, guard, command = int(arguments[0]), int(arguments[1]), arguments[2:]
    with contextlib.suppress(OSError):  # no guard any more: the kernel's arrangement is enough
        os.write(guard, f"{os.getpid()}\n".encode())
    os.set_inheritable(guard, False)
    if end_with_parent(supervisor, signal.SIGINT):
        os.execv(command[0], command)


if __name__ == "__main__":
    main(sys.argv[1:])

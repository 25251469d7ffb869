"""A loop that does nothing, every millisecond, in a process of its own: is the machine ours?

If it is late, the machine was busy, and no loop could keep real time.
"""

from __future__ import annotations

import mmap
import os
import struct
import subprocess
import sys

from ros_bench import die_with_the_test

LATE_MS = 10.0
"""A quiet machine is late by less than 5 ms; one that shares a core with others by 10 to 30 ms."""

_LOOP = """
import mmap, struct, sys, time
memory = mmap.mmap(int(sys.argv[1]), 8)
due = time.monotonic()
while True:
    due += 1e-3
    time.sleep(max(0.0, due - time.monotonic()))
    now = time.monotonic()
    if now - due > struct.unpack("d", memory)[0]:
        memory[:] = struct.pack("d", now - due)
    due = max(due, now - 1e-3)
"""


class EmptyLoop:
    """The loop's process; it ends with the tests."""

    def __init__(self) -> None:
        shared = os.memfd_create("late")
        os.truncate(shared, 8)
        self._memory = mmap.mmap(shared, 8)
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _LOOP, str(shared)],
            stdin=subprocess.DEVNULL,
            pass_fds=(shared,),
            preexec_fn=die_with_the_test,
        )
        os.close(shared)

    def begin(self) -> None:
        """Reset the measured delays."""
        self._memory[:] = struct.pack("d", 0.0)

    def late_ms(self) -> float:
        """Return by how much the loop was late at most [ms], since it began."""
        return 1e3 * float(struct.unpack("d", self._memory)[0])

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()

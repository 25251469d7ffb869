"""Prints the frames of a motion-capture system as JSON lines; a process of its own.

    python -m tombo_mocap.frame_reader PARENT_PID SYSTEM '{"hostname": "192.168.1.5"}'

A line is [arrival in ns of the system clock, {name: [x, y, z, qx, qy, qz, qw]}]. The library can
wait for ever while it connects, and prints to standard output: here both do no harm.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time

from tombo_dynamics.launcher import end_with_parent


def main(arguments: list[str]) -> int:
    """Connect, and print every frame until the parent ends; return the exit code."""
    parent, system, options = int(arguments[0]), arguments[1], json.loads(arguments[2])
    if not end_with_parent(parent, signal.SIGKILL):
        return 0
    frames = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    try:
        import motioncapture
    except ImportError:
        return _refuse("the library motioncapture is not installed; `pip install motioncapture`")
    try:
        source = motioncapture.connect(system, options)
        while True:
            source.waitForNextFrame()
            arrival_ns = time.time_ns()
            bodies = {}
            for name, body in source.rigidBodies.items():
                q = body.rotation
                bodies[name] = [*map(float, body.position), q.x, q.y, q.z, q.w]
            frames.write(f"{json.dumps([arrival_ns, bodies])}\n")
    except RuntimeError as error:
        return _refuse(str(error))


def _refuse(text: str) -> int:
    sys.stderr.write(f"{text}\n")
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

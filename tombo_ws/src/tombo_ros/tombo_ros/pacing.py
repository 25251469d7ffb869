"""Sleeping until an absolute time, and real-time priority for loops."""

from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import os
import threading
import time
from dataclasses import dataclass

from tombo_dynamics.time_base import SECOND_NS

_TIMER_ABSTIME = 1


class _Timespec(ctypes.Structure):
    _fields_ = (("sec", ctypes.c_long), ("nsec", ctypes.c_long))


_libc = ctypes.CDLL(ctypes.util.find_library("c") or "libc.so.6", use_errno=True)
_nanosleep = _libc.clock_nanosleep
_nanosleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.POINTER(_Timespec), ctypes.c_void_p)
_prctl = _libc.prctl
_PR_SET_TIMERSLACK = 29


def sleep_until(deadline_ns: int) -> None:
    """Sleep until `time.monotonic_ns()` is `deadline_ns`, or a signal comes.

    To an absolute time, so lateness of one run does not shift the next (clock_nanosleep(2)).
    """
    seconds, rest = divmod(deadline_ns, SECOND_NS)
    _nanosleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(_Timespec(seconds, rest)), None)


@dataclass(frozen=True)
class Priority:
    """Priorities of a process's threads under SCHED_FIFO; 0: none is requested."""

    loop: int = 0
    transport: int = 0
    """The middleware's threads: a message that waits for them is late for everybody."""


SIMULATOR = Priority(50, 46)
CONTROLLER = Priority(49, 47)
ESTIMATOR = Priority(44, 45)
COLLISION = Priority(43, 43)
MISSION = Priority(42, 42)
RECORDER = Priority(38, 45)
"""SCHED_FIFO priorities: higher for shorter periods. The recorder's loop comes last, but before
other processes: in a flight it needs a fifth of a core, and missed messages are lost. Its
middleware only puts messages into queues, and those of the publishers are short."""


def request_realtime_priority(priority: Priority, leave_out: set[int]) -> str:
    """Move the process's threads to SCHED_FIFO if the system allows it; say what was got.

    Args:
        priority: the calling thread is the loop, all others are the middleware's.
        leave_out: thread ids that stay as they are.

    Returns:
        As "FIFO 50", "normal, transport FIFO 40", or "normal (...)" with the reason.
    """
    _prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    loop_thread = threading.get_native_id()
    try:
        if priority.loop:
            os.sched_setscheduler(loop_thread, os.SCHED_FIFO, os.sched_param(priority.loop))
        for thread in map(int, os.listdir("/proc/self/task")):
            if thread != loop_thread and thread not in leave_out:
                with contextlib.suppress(ProcessLookupError):
                    behind = os.sched_param(priority.transport)
                    os.sched_setscheduler(thread, os.SCHED_FIFO, behind)
    except OSError as error:
        highest = max(priority.loop, priority.transport)
        return f"normal ({error.strerror}; allow rtprio {highest} in limits.conf)"
    return (
        f"FIFO {priority.loop}"
        if priority.loop
        else f"normal, transport FIFO {priority.transport}"
    )

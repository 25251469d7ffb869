"""Waiting for an absolute time, and a place in front of the queue for loops that must not wait."""

from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import gc
import os
import threading
import time

_FIFO_PRIORITY = 50
_TIMER_ABSTIME = 1
_SECOND_NS = 1_000_000_000


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
    seconds, rest = divmod(deadline_ns, _SECOND_NS)
    _nanosleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(_Timespec(seconds, rest)), None)


def ask_for_realtime(leave_out: set[int], loop_too: bool = True) -> str:
    """Move the process's threads to SCHED_FIFO if the system allows it; say what was got.

    The calling thread comes first, the middleware's threads right behind it: a gyro sample that
    waits for a thread without priority is late for a loop with one.

    Args:
        leave_out: thread ids that stay as they are.
        loop_too: False: the calling thread stays as it is, only the middleware's are moved.

    Returns:
        "FIFO 50", "normal, transport FIFO 49", or "normal (...)" with the reason.
    """
    _prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    own = threading.get_native_id()
    try:
        if loop_too:
            os.sched_setscheduler(own, os.SCHED_FIFO, os.sched_param(_FIFO_PRIORITY))
        for thread in map(int, os.listdir("/proc/self/task")):
            if thread != own and thread not in leave_out:
                with contextlib.suppress(ProcessLookupError):
                    behind = os.sched_param(_FIFO_PRIORITY - 1)
                    os.sched_setscheduler(thread, os.SCHED_FIFO, behind)
    except OSError as error:
        return f"normal ({error.strerror}; allow rtprio {_FIFO_PRIORITY} in limits.conf)"
    return f"FIFO {_FIFO_PRIORITY}" if loop_too else f"normal, transport FIFO {_FIFO_PRIORITY - 1}"


def quiet_collector() -> None:
    """Keep the garbage collector out of the loop: what is there stays, the young is looked at."""
    gc.collect()
    gc.freeze()
    gc.disable()


def collect_young() -> None:
    """Collect what the last second left; takes some microseconds."""
    gc.collect(0)

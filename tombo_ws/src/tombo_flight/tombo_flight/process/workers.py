"""The same work on many items, on processes that end with this one."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Any, TypeVar

from tombo_flight.own_files import import_files, imported_files

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_END: Any = object()
_WAITING = 4
"""Items handed out to each process in advance."""
_LOOK_S = 0.1
"""Period of the checks of `stop` [s]."""


def process_count(workers: int | None) -> int:
    """Return `workers`, or a process for each core that this one may use."""
    return workers or len(os.sched_getaffinity(0))


def run_in_processes(
    work: Callable[[_Item], _Result],
    items: Iterable[_Item],
    workers: int,
    *,
    begin: Callable[..., None] | None = None,
    given: tuple[Any, ...] = (),
    stop: Callable[[], bool] | None = None,
    copies: bool = False,
) -> Generator[_Result, None, None]:
    """Yield results as they come, in any order; closing the generator ends all processes.

    Args:
        work: what is done with each item; a function of a module.
        items: the items.
        workers: number of processes.
        begin: called once in each process with `given`.
        given: arguments of `begin`.
        stop: asked ten times a second; True ends all processes.
        copies: start the processes as copies of this one, where no other threads run in it: all
            code is loaded already, which saves each two seconds. Not for work that needs another
            number of threads of linear algebra than this process has.

    Raises:
        Exception: what `work` raised first; all processes are ended.
    """
    waiting: set[Future[_Result]] = set()
    strangers = set(multiprocessing.active_children())
    left = iter(items)
    # The locks of other threads would be taken for ever in a copy.
    start = "fork" if copies and threading.active_count() == 1 else "spawn"
    # A new process has the user's files before it reads what may be made of them.
    told = (begin, given) if start == "fork" else pickle.dumps((begin, given))
    executor = ProcessPoolExecutor(
        workers, multiprocessing.get_context(start), _begin, (imported_files(), told)
    )
    whole = False
    try:
        while not (stop is not None and stop()):
            while len(waiting) < _WAITING * workers and (item := next(left, _END)) is not _END:
                waiting.add(_submit(executor, work, item))
            if not waiting:
                whole = True
                return
            finished, waiting = wait(waiting, _LOOK_S, FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    finally:
        if not whole:
            for process in set(multiprocessing.active_children()) - strangers:
                process.kill()
        executor.shutdown(cancel_futures=True)


def _submit(
    executor: ProcessPoolExecutor, work: Callable[[_Item], _Result], item: _Item
) -> Future[_Result]:
    """Hand out an item. Processes started by that never see Ctrl-C: the parent handles it.

    A terminal sends Ctrl-C to parent and children alike; a blocked signal is inherited.
    """
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return executor.submit(work, item)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _begin(files: Sequence[tuple[str, str]], told: Any) -> None:
    """Prepare a process: it ends when its parent does, and has imported the same files."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import_files(path for path, _ in files)
    begin, given = pickle.loads(told) if isinstance(told, bytes) else told
    if begin is not None:
        begin(*given)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

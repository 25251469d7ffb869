"""The same work on many items: on processes that end with this one, or on a Dask cluster."""

from __future__ import annotations

import asyncio
import importlib.util
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from typing import Any, TypeVar

from tombo_dynamics.errors import InputError
from tombo_flight.own_files import import_files, imported_files
from tombo_flight.version import tombo_version

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
        work: processes one item; a function of a module.
        items: the items.
        workers: number of processes.
        begin: called once in each process with `given`.
        given: arguments of `begin`.
        stop: called ten times a second; True ends all processes.
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


_AHEAD = 4
"""Items handed out to each thread of the cluster in advance."""
_ANSWERS_S = 4.0
"""Time that a scheduler may take to answer."""
_CLUSTER_LOOK_S = 0.02
_here = threading.local()


def run_on_cluster(
    address: str,
    work: Callable[[_Item], _Result],
    items: Iterable[_Item],
    *,
    begin: Callable[..., None],
    given: tuple[Any, ...],
    stop: Callable[[], bool] | None = None,
) -> Generator[_Result, None, None]:
    """Yield results as they come, in any order; another worker does what a lost one had.

    Args:
        address: of the scheduler.
        work: processes one item; a function of a module.
        items: the items; each costs the scheduler several milliseconds.
        begin: called once in each thread of the workers with `given`.
        given: arguments of `begin`.
        stop: called now and then; True ends the work.

    Raises:
        InputError: the scheduler can't be reached, or has another version of the suite.
    """
    check_scheduler(address)
    from distributed import Client, as_completed

    with Client(address, timeout=_ANSWERS_S, set_as_default=False) as client:
        told = (begin, given, tombo_version(), imported_files())
        shared = client.scatter(told, broadcast=True)
        left = iter(items)
        waiting = as_completed(loop=client.loop)

        def hand_out() -> None:
            ahead = _AHEAD * max(sum(client.nthreads().values()), 1)
            while waiting.count() < ahead and (item := next(left, _END)) is not _END:
                waiting.add(client.submit(_on_worker, shared, work, item, pure=False))

        hand_out()
        while waiting.count() and not (stop is not None and stop()):
            for future in waiting.next_batch(block=False) or _after(_CLUSTER_LOOK_S):
                yield future.result()
                future.release()
            hand_out()


def _on_worker(
    told: tuple[Callable[..., None], tuple[Any, ...], str, tuple[tuple[str, str], ...]],
    work: Callable[[_Item], _Result],
    item: _Item,
) -> _Result:
    """Do the work on a worker.

    Raises:
        InputError: the worker has another version of the suite, or not the user's files.
    """
    begin, given, version, imports = told
    if version != tombo_version():
        raise InputError(f"--scheduler: a worker has tombo {tombo_version()}; accepted: {version}")
    import_files(path for path, _ in imports)
    if getattr(_here, "begun", None) != (begin, given):
        begin(*given)
        _here.begun = (begin, given)
    return work(item)


def check_scheduler(address: str) -> None:
    """Reach for a Dask scheduler; its client leaves threads behind where there is none.

    Raises:
        InputError: Dask is not installed, or nothing answers.
    """
    if importlib.util.find_spec("distributed") is None:
        raise InputError(
            f"--scheduler {address}: Dask is not installed; accepted: after "
            "pip install -r requirements-study.txt"
        )
    from distributed.comm.core import connect

    async def reach() -> None:
        (await connect(address, timeout=_ANSWERS_S)).abort()

    try:
        with ThreadPoolExecutor(1) as other:  # this thread may have a loop of its own
            other.submit(asyncio.run, reach()).result()
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: it can't be reached ({error}); accepted: the address of a "
            "Dask scheduler, as in tcp://10.0.0.1:8786"
        ) from None


def _after(seconds: float) -> tuple[()]:
    """Return nothing, after a while."""
    time.sleep(seconds)
    return ()

"""Flies what is missing of a sweep: on the cores of this machine, or on a cluster by Dask."""

from __future__ import annotations

import asyncio
import importlib.util
import threading
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from itertools import islice
from typing import Any

from tombo_collision.own_reactions import import_reactions
from tombo_dynamics.errors import InputError
from tombo_flight.flight_output import warm_up_flight
from tombo_flight.process.process_pool import process_count, stream_from_processes
from tombo_flight.sweep.store import Store
from tombo_flight.sweep.study import Flyer, Study
from tombo_flight.version import tombo_version

_LARGEST_BATCH = 64
"""Flights of a task of Dask: a task costs its scheduler several milliseconds."""
_TASKS = 32
"""Tasks that each thread gets at least, so that all end at about the same time."""
_AHEAD = 4
"""Tasks handed out to each thread of the cluster in advance."""
_ANSWERS_S = 4.0
"""So long a scheduler may take to answer."""
_LOOK_S = 0.02
_here = threading.local()

Progress = Callable[[int, float | None], None]
"""Called with the number of flights kept, and the time left [s] where it is known."""


def fly_missing(
    store: Store,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
) -> bool:
    """Fly the flights that the store does not have, and join them; return whether all are there.

    Args:
        store: where they go.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        progress: told the progress.
        stop: asked now and then; True ends it, with what was flown on disk.

    Raises:
        InputError: the scheduler can't be reached, or has another version of the suite.
        OSError: the folder can't be written.
    """
    if store.finished:
        return True
    count = process_count(workers)
    if scheduler is None:
        with suppress(InputError):  # a flight that can't be flown says so in its row
            warm_up_flight(store.study.scenario_at(0))  # once, not in each process
        rows = stream_from_processes(
            _fly,
            store.missing(),
            count,
            begin=_begin,
            given=(store.study,),
            stop=stop,
            copies=True,
        )
    else:
        missing = store.study.flights - store.kept
        rows = _stream_from_dask(scheduler, store.study, store.missing(), missing, stop)
    began, before = time.monotonic(), store.kept
    with closing(rows):
        for row in rows:
            store.keep(row)
            if progress is not None:
                rate = (store.kept - before) / max(time.monotonic() - began, 1e-6)
                progress(store.kept, (store.study.flights - store.kept) / rate)
    if store.kept < store.study.flights:
        return False
    store.finish()
    return True


def _begin(study: Study) -> None:
    """Prepare a process or a thread: it keeps study and memory."""
    _here.flyer = Flyer(study)


def _fly(flight: int) -> dict[str, Any]:
    row: dict[str, Any] = _here.flyer.fly(flight)
    return row


def _fly_batch(study: Study, flights: list[int]) -> list[dict[str, Any]]:
    """Fly on a worker of Dask.

    Raises:
        InputError: the worker has another version of the suite, or not the user's reactions.
    """
    if study.version != tombo_version():
        raise InputError(
            f"--scheduler: a worker has tombo {tombo_version()}; accepted: {study.version}"
        )
    import_reactions(path for path, _ in study.imports)
    flyer = getattr(_here, "flyer", None)
    if flyer is None or flyer.study != study:
        _begin(study)
    return [_fly(flight) for flight in flights]


def _stream_from_dask(
    address: str, study: Study, flights: Iterable[int], count: int, stop: Callable[[], bool] | None
) -> Generator[dict[str, Any], None, None]:
    """Yield rows of `count` flights as they come; another worker flies what a lost one had."""
    check_scheduler(address)
    from distributed import Client, as_completed

    with Client(address, timeout=_ANSWERS_S, set_as_default=False) as client:
        shared = client.scatter(study, broadcast=True)
        threads = max(sum(client.nthreads().values()), 1)
        size = min(max(count // (_TASKS * threads), 1), _LARGEST_BATCH)
        left = iter(flights)
        waiting = as_completed(loop=client.loop)

        def hand_out() -> None:
            ahead = _AHEAD * max(sum(client.nthreads().values()), 1)
            while waiting.count() < ahead and (batch := list(islice(left, size))):
                waiting.add(client.submit(_fly_batch, shared, batch, pure=False))

        hand_out()
        while waiting.count() and not (stop is not None and stop()):
            for future in waiting.next_batch(block=False) or _after(_LOOK_S):
                yield from future.result()
                future.release()
            hand_out()


def check_scheduler(address: str) -> None:
    """Ask for a Dask scheduler at an address; its client would wait half a minute for none.

    Raises:
        InputError: Dask is not installed, or no scheduler answers.
    """
    if importlib.util.find_spec("distributed") is None:
        raise InputError(
            f"--scheduler {address}: Dask is not installed; accepted: after "
            "pip install -r requirements-study.txt"
        )
    with ThreadPoolExecutor(1) as other:  # this thread may have a loop of its own
        problem = other.submit(asyncio.run, _problem_with(address)).result()
    if problem:
        raise InputError(
            f"--scheduler {address}: it can't be reached ({problem}); accepted: the address of a "
            "Dask scheduler, as in tcp://10.0.0.1:8786"
        )


async def _problem_with(address: str) -> str:
    """Return why no Dask scheduler answers at an address; empty: one does."""
    from distributed.comm.core import connect

    async def ask() -> Any:
        stream = await connect(address, timeout=_ANSWERS_S)
        try:
            await stream.write({"op": "identity", "reply": True})
            return await stream.read()
        finally:
            stream.abort()

    try:
        answer = await asyncio.wait_for(ask(), _ANSWERS_S)
    except (OSError, ValueError) as error:
        return str(error) or f"no answer within {_ANSWERS_S:g} s"
    kind = answer.get("type") if isinstance(answer, Mapping) else None
    return "" if kind == "Scheduler" else f"it is no scheduler: {kind}"


def _after(seconds: float) -> tuple[()]:
    """Return nothing, after a while."""
    time.sleep(seconds)
    return ()

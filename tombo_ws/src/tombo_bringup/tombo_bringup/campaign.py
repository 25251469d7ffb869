"""The same scenario flown with many seeds, on all cores; each flight as if it were alone."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Any

from tombo_bringup.campaign_statistics import aggregate
from tombo_bringup.flight import Workspace, fly_scenario
from tombo_bringup.flight_output import flight_summary
from tombo_bringup.scenario import Scenario
from tombo_bringup.version import tombo_version
from tombo_dynamics.errors import InputError

_WAITING = 4
"""Flights handed out to each process in advance."""
_LOOK_S = 0.1
"""How often the wish to stop is looked at."""

_scenario: Scenario
_workspace: Workspace


def fly_campaign(
    scenario: Scenario,
    seeds: range,
    *,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[str, Any]:
    """Fly a scenario with each of the seeds and return the campaign's summary.

    The order of the flights is that of the seeds, whichever process flew them. A campaign that is
    stopped holds the flights up to the first one missing.

    Args:
        scenario: what to fly; `flight_output.rehearse` it first.
        seeds: the seeds.
        workers: number of processes; the cores that this process may use if None.
        progress: called with the number of flights done.
        stop: asked ten times a second; True ends all processes and the campaign.

    Returns:
        scenario, model, conf, law, reaction, first_seed, last_seed, tombo_version, interrupted,
        `flights` (summaries, see `flight_output`) and `aggregate` (see `campaign_statistics`).

    Raises:
        InputError: as `fly_scenario`, with the seed; all processes are ended.
    """
    began = time.perf_counter()
    count = min(workers or len(os.sched_getaffinity(0)), len(seeds))
    flights = _fly_all(scenario, seeds, count, progress, stop)
    wall = time.perf_counter() - began
    return {
        "tombo_version": tombo_version(),
        "scenario": scenario.name,
        "model": scenario.model or None,
        "conf": scenario.propeller.conf,
        "law": scenario.propeller.law,
        "reaction": scenario.react,
        "first_seed": seeds[0],
        "last_seed": seeds[-1],
        "interrupted": len(flights) < len(seeds),
        "flights": flights,
        "aggregate": aggregate(flights, wall),
    }


def _fly_all(
    scenario: Scenario,
    seeds: range,
    workers: int,
    progress: Callable[[int], None] | None,
    stop: Callable[[], bool] | None,
) -> list[dict[str, Any]]:
    """Return the summaries in the order of the seeds, up to the first one missing."""
    done: dict[int, dict[str, Any]] = {}
    waiting: set[Future[tuple[int, dict[str, Any]]]] = set()
    strangers = set(multiprocessing.active_children())
    left = iter(seeds)
    executor = ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), _begin, (scenario,)
    )
    try:
        while len(done) < len(seeds) and not (stop is not None and stop()):
            while len(waiting) < _WAITING * workers and (seed := next(left, None)) is not None:
                waiting.add(_submit(executor, seed))
            finished, waiting = wait(waiting, _LOOK_S, FIRST_COMPLETED)
            done.update(future.result() for future in finished)
            if progress is not None and finished:
                progress(len(done))
    finally:
        if len(done) < len(seeds):
            for process in set(multiprocessing.active_children()) - strangers:
                process.kill()
        executor.shutdown(cancel_futures=True)
    flights = []
    for seed in seeds:
        if seed not in done:
            break
        flights.append(done[seed])
    return flights


def _submit(executor: ProcessPoolExecutor, seed: int) -> Future[tuple[int, dict[str, Any]]]:
    """Hand out a flight. Processes started by that never see Ctrl-C: it is the parent's to answer.

    A terminal sends Ctrl-C to parent and children alike; a blocked signal is inherited.
    """
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return executor.submit(_fly, seed)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _begin(scenario: Scenario) -> None:
    """Prepare a process: it keeps scenario and memory, and ends when its parent does."""
    global _scenario, _workspace
    _scenario, _workspace = scenario, Workspace()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _fly(seed: int) -> tuple[int, dict[str, Any]]:
    try:
        return seed, flight_summary(fly_scenario(_scenario, seed, _workspace))
    except InputError as error:
        raise InputError(f"seed {seed}: {error}") from error

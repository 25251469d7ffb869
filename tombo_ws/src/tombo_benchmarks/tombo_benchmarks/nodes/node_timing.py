"""How punctual the nodes are on this machine.

The nodes fly the paper's flight, and tell their figures on `/diagnostics`. An empty loop before
and after it shows the lateness of the machine itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from tombo_bag.recording import Recording
from tombo_dynamics.time_base import TICK_S
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.node_diagnostics import node_metrics
from tombo_flight.suite.nodes import SUITE, free_domain, groups, udp_ports
from tombo_flight.suite.running import RunningSuite, SuiteConfig

_PRIORITY: Final = 50
"""That of the simulator's loop under SCHED_FIFO."""


@contextmanager
def running_suite(vehicles: int) -> Iterator[tuple[RunningSuite, Path]]:
    """Start the suite and wait until every node reports; give it with its recording."""
    names = (
        {name for group in groups(vehicles).values() for name in group} if vehicles else {*SUITE}
    )
    with TemporaryDirectory(prefix="tombo-") as folder:
        bag = Path(folder) / "flight.mcap"
        config = SuiteConfig(
            load_scenario(*(["hover"] if vehicles else [])),
            0,
            Path(folder) / "suite",
            {"output": str(bag)},
            domain=free_domain(os.getpid(), udp_ports()),
            vehicles=vehicles,
        )
        with RunningSuite(config) as suite:
            while not suite.node_diagnostics.nodes.keys() >= names:
                suite.poll(0.05)
            yield suite, bag


@contextmanager
def busy_processes(number: int) -> Iterator[None]:
    """Keep `number` processes computing."""
    spin = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(spin) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def empty_loop(seconds: float) -> dict[str, float | int]:
    """Return how late a loop of 1 kHz with nothing in it runs here and now."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    began_s = time.monotonic()
    due_s = began_s + TICK_S * np.arange(1, round(seconds / TICK_S) + 1)
    late_us = np.empty(len(due_s))
    for k, due in enumerate(due_s.tolist()):
        time.sleep(max(0.0, due - time.monotonic()))
        late_us[k] = 1e6 * (time.monotonic() - due)
    took_s = time.monotonic() - began_s
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    median, p99 = np.percentile(late_us, (50.0, 99.0)).tolist()
    rate_hz = len(due_s) / took_s
    return {"rate_hz": rate_hz, "jitter_p50_us": median, "jitter_p99_us": p99, "missed": 0}


def fly_and_measure(seconds: float, busy: int, vehicles: int = 0) -> dict[str, Any]:
    """Return the figures of `node_metrics` of a flight, and of an empty loop around it.

    Args:
        seconds: to fly once all nodes report [s].
        busy: further processes that never sleep.
        vehicles: how many hover side by side; 0: one flies the paper's flight.
    """
    with busy_processes(busy):
        before = empty_loop(0.25 * seconds)
        with running_suite(vehicles) as (suite, bag):
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                suite.poll(0.25)
            suite.stop()
            with Recording(bag) as recording:
                measured = node_metrics(recording)
        after = empty_loop(0.25 * seconds)
    loops = {"empty loop before": before, **measured["loops"], "empty loop after": after}
    return {**measured, "loops": loops}

"""The measurements: each function returns the median of several runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from tombo_benchmarks.speed.kernel_flight import (
    KernelFlight,
    Stretch,
    contact_time,
    fly_whole,
    new_flight,
    stretches,
)
from tombo_collision.reactions.policy import Policy
from tombo_collision.steering import ACTIONS
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_output import write_mcap
from tombo_flight.scenario import Scenario, load_scenario
from tombo_flight.training import Episodes

Share = list[tuple[KernelFlight, list[Stretch]]]
ProgressText = Callable[[str], None]

_FIRST_CALL = """
import time
start = time.perf_counter()
from tombo_benchmarks.speed.kernel_flight import new_flight, stretches
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario
scenario = load_scenario()
ready = time.perf_counter()
flight = new_flight(scenario, 0)
leg, mode, first, _ = stretches(flight, 23.0)[0]
flight.stretch(leg, mode, first, first + 1)
called = time.perf_counter()
fly_scenario(scenario, 0)
import json
print(json.dumps([ready - start, called - ready, time.perf_counter() - called]))
"""


def kernel_steps(runs: int = 9) -> float:
    """Return steps per second of the bare kernel in the paper's scenario, one core, warm."""
    scenario = load_scenario()
    contact = contact_time(scenario, 0)
    rates = []
    for _ in range(runs + 1):
        flight = new_flight(scenario, 0)
        legs = stretches(flight, contact)
        began = time.perf_counter()
        steps = fly_whole(flight, legs)
        rates.append(steps / (time.perf_counter() - began))
    return median(rates[1:])


def batch_steps(threads: int, vehicles: int = 32, runs: int = 5) -> float:
    """Return vehicle-steps per second of many vehicles on `threads` threads; no GIL is held.

    Each vehicle has its own seed, so its own thrust scatter, start and time of contact.
    """
    scenario = load_scenario()
    contacts = [contact_time(scenario, seed) for seed in range(vehicles)]
    rates = []
    for _ in range(runs + 1):
        flights = [new_flight(scenario, seed) for seed in range(vehicles)]
        legs = [stretches(f, contacts[i]) for i, f in enumerate(flights)]
        pairs = list(zip(flights, legs, strict=True))
        shares = [pairs[thread::threads] for thread in range(threads)]
        workers = [threading.Thread(target=_fly_share, args=(share,)) for share in shares]
        began = time.perf_counter()
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        steps = sum(stretch[3] - stretch[2] for one in legs for stretch in one)
        rates.append(steps / (time.perf_counter() - began))
    return median(rates[1:])


def training_episodes(count: int, threads: int, starts: int) -> Episodes:
    """Return a batch of vehicles of the training environment, each at its collision.

    Args:
        count: vehicles.
        threads: that fly them.
        starts: flights up to the collision from which they begin.
    """
    scenario = load_scenario()
    steered = replace(scenario, reaction=Policy(**vars(scenario.reaction)))
    episodes = Episodes(steered, count, threads, starts)
    rngs = [np.random.default_rng(seed) for seed in range(count)]
    episodes.reset(range(count), rngs, list(range(count)))
    return episodes


def training_ticks(threads: int, vehicles: int = 64, runs: int = 5, steps: int = 200) -> float:
    """Return ticks per second of the training environment, episodes that end being begun anew."""
    episodes = training_episodes(vehicles, threads, vehicles)
    rng, done = np.random.default_rng(0), np.zeros(vehicles, bool)
    rngs = [np.random.default_rng(seed) for seed in range(vehicles)]
    actions = rng.uniform(-0.3, 0.3, (steps, vehicles, ACTIONS))
    rates = []
    for _ in range(runs + 1):
        ticks, began = 0, time.perf_counter()
        for action in actions:
            again = np.flatnonzero(done).tolist()
            fresh = [rngs[i] for i in again]
            begin = {"which": again, "rngs": fresh, "seeds": [None] * len(again)}
            flown = episodes.batch.flights.progress["tick"].copy()
            outcome = episodes.step(action, ~done, **(begin if again else {}))
            flown = episodes.batch.flights.progress["tick"] - flown
            ticks += int(flown[~done].sum())
            done = outcome.terminated | outcome.truncated
        rates.append(ticks / (time.perf_counter() - began))
    episodes.close()
    return median(rates[1:])


def _fly_share(share: Share) -> None:
    for flight, legs in share:
        fly_whole(flight, legs)


def flight_speed(scenario: Scenario, runs: int = 9) -> tuple[float, float]:
    """Return how many times faster than real time whole flights are: alone, and recorded."""
    workspace = Workspace()
    alone, recorded = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(-1, runs):
            record = fly_scenario(scenario, max(seed, 0), workspace)
            flown, wall = record.summary["duration_s"], record.summary["wall_time_s"]
            began = time.perf_counter()
            write_mcap(record, Path(folder) / "flight.mcap")
            writing = time.perf_counter() - began
            if seed >= 0:
                alone.append(flown / wall)
                recorded.append(flown / (wall + writing))
    return median(alone), median(recorded)


def first_call(runs: int = 3) -> list[float]:
    """Return wall times of a fresh process [s], compiled code being cached.

    Until everything is imported; from there to the first tick of the bare kernel, its vehicle set
    up and its code loaded; of the first whole flight after that.
    """
    command = [sys.executable, "-c", _FIRST_CALL]
    found = [
        json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        for _ in range(runs)
    ]
    return [median(column) for column in zip(*found, strict=True)]


def measure(said: ProgressText = lambda text: None) -> dict[str, float | int | None]:
    """Measure everything; `said` is called with the name of the next measurement.

    Returns:
        Steps per second of kernel, batch and training environment; threads of the batch.
        Real-time factors of flights, and times of the first calls [s].
    """
    said("bare kernel")
    kernel = kernel_steps()
    threads = min(2, len(os.sched_getaffinity(0)))
    said(f"batch on {threads} threads")
    batch = batch_steps(threads)
    said(f"training environment on {threads} threads")
    training = training_ticks(threads)
    said("whole flights")
    alone, recorded = flight_speed(load_scenario())
    said("first calls")
    imports_s, kernel_s, flight_s = first_call()
    return {
        "kernel_steps_per_s": kernel,
        "batch_steps_per_s": batch,
        "batch_threads": threads,
        "training_ticks_per_s": training,
        "flight_real_time_factor": alone,
        "recorded_flight_real_time_factor": recorded,
        "imports_s": imports_s,
        "first_kernel_call_s": kernel_s,
        "first_flight_s": flight_s,
    }

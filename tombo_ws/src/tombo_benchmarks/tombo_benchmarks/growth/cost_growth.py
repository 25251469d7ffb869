"""Measures seconds and bytes of growing flights, each size in a process, and their slopes."""

from __future__ import annotations

import math
import multiprocessing
import os
import resource
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import stats

from tombo_benchmarks.speed.speed_measurements import training_episodes
from tombo_collision.steering import ACTIONS
from tombo_dynamics.effects.registry import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import flight_summary, write_mcap
from tombo_flight.process.study import fly_seeds
from tombo_flight.scenario import load_scenario
from tombo_sim.batch import WAITS

CORES: Final = len(os.sched_getaffinity(0))
_STEPS: Final = 25
"""Of 20 ms, that many vehicles fly."""
_STARTS: Final = 32
"""Flights up to the collision from which they begin."""
_HOVER_S: Final = 20.0
_SMALL: Final = 0.01
"""Share of an effect's typical size: it is computed, and the flight stays what it is."""
_MOST_ROUNDS: Final = 5
_MOST_MEMORY: Final = 0.5
"""Share of the free memory that a size may be expected to take."""
ProgressText = Callable[[str], None]


class SizeCost(NamedTuple):
    """What one size has cost."""

    seconds: float
    """Wall time."""
    size: float
    """[byte]"""


class Slope(NamedTuple):
    """Growth as a power of the size, with its 95 % interval."""

    power: float
    low: float
    high: float


@dataclass(frozen=True)
class Axis:
    """What grows."""

    name: str
    flown: str
    """What is timed."""
    kept: str
    """What the bytes are."""
    sizes: tuple[int, ...]
    run: Callable[[int], tuple[float, float | None]]
    """Return the wall time [s] and the bytes written; None: those of memory count."""


@dataclass
class Growth:
    """What was measured of an axis."""

    axis: Axis
    readings: dict[int, list[SizeCost]] = field(default_factory=dict)
    left_out: dict[int, str] = field(default_factory=dict)
    """Size → why it was not run."""


def fly_vehicles(count: int, threads: int = CORES) -> tuple[float, None]:
    """Fly a batch of vehicles for half a second after their collisions."""
    episodes = training_episodes(count, threads, min(count, _STARTS))
    actions = np.zeros((count, ACTIONS))
    began = time.perf_counter()
    for _ in range(_STEPS):
        episodes.step(actions, episodes.batch.status == WAITS)
    seconds = time.perf_counter() - began
    episodes.close()
    return seconds, None


def fly_many(count: int) -> tuple[float, None]:
    """Fly whole flights without files, as `tombo fly --seeds --no-record`."""
    began = time.perf_counter()
    fly_seeds(load_scenario("paper_collision"), range(count), flight_summary, summary_only=True)
    return time.perf_counter() - began, None


def fly_long(duration: int) -> tuple[float, float]:
    """Fly and record a hover of so many seconds."""
    return _recorded([f"duration={duration}"])


def record_often(rate: int) -> tuple[float, float]:
    """Fly and record a hover with so many poses a second."""
    return _recorded([f"duration={_HOVER_S}", f"estimator.mocap_rate={rate}"])


def _recorded(settings: Sequence[str]) -> tuple[float, float]:
    scenario = load_scenario("hover", [*settings, "mission.land_time=3600"])
    with TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mcap"
        began = time.perf_counter()
        write_mcap(fly_scenario(scenario, 0), path)
        return time.perf_counter() - began, path.stat().st_size


def fly_effects(count: int) -> tuple[float, None]:
    """Fly a hover with the first effects of the registry, each small."""
    chosen = list(REGISTRY.values())[:count]
    effects = {
        effect.name: {p.name: p.null + _SMALL * (p.typical - p.null) for p in effect.theta}
        for effect in chosen
    }
    scenario = replace(load_scenario("hover", [f"duration={_HOVER_S}"]), effects=effects)
    began = time.perf_counter()
    fly_scenario(scenario, 0)
    return time.perf_counter() - began, None


def _doubled(last: int) -> tuple[int, ...]:
    return (*(2**k for k in range(last.bit_length()) if 2**k < last), last)


AXES: Final = (
    Axis(
        "vehicles",
        f"{_STEPS} steps of the vector environment, after {_STARTS} kept starts",
        "memory",
        (1, 10, 30, 100, 300, 1000, 3000, 10_000, 30_000, 100_000),
        fly_vehicles,
    ),
    Axis(
        "flights",
        "whole flights, `tombo fly --seeds --no-record`",
        "memory of the command",
        (1, 10, 30, 100, 300, 1000, 3000, 10_000, 100_000, 1_000_000),
        fly_many,
    ),
    Axis("length [s]", "a hover, recorded", "file", (10, 30, 100, 300, 1000, 3000), fly_long),
    Axis(
        "effects",
        f"a hover of {_HOVER_S:g} s, effects of a hundredth of their size",
        "memory",
        _doubled(len(REGISTRY)),
        fly_effects,
    ),
    Axis(
        "cores",
        f"{_STEPS} steps of 1000 vehicles on so many threads",
        "memory",
        _doubled(CORES),
        partial(fly_vehicles, 1000),
    ),
    Axis(
        "poses [1/s]",
        f"a hover of {_HOVER_S:g} s, recorded with so many poses a second",
        "file",
        (5, 10, 30, 100, 300, 500),
        record_often,
    ),
)


def measure(
    seconds: float, axes: Sequence[Axis] = AXES, progress: ProgressText = lambda text: None
) -> list[Growth]:
    """Run the sizes of all axes as far as the time allows, then again, at most five times.

    Args:
        seconds: in all; each axis has its share, and what those before it have left.
        axes: what grows.
        progress: called with what comes next.
    """
    stop = time.perf_counter() + seconds
    _load()
    found = []
    for i, axis in enumerate(axes):
        now = time.perf_counter()
        found.append(_grown(axis, now + max(stop - now, 0.0) / (len(axes) - i), progress))
    return found


def _load() -> None:
    """Load compiled code before processes are copied."""
    fly_vehicles(2, 1)
    _recorded(["duration=1"])


def _grown(axis: Axis, stop: float, progress: ProgressText) -> Growth:
    growth, cost = Growth(axis), dict[int, float]()
    for number in range(_MOST_ROUNDS):
        for size in axis.sizes:
            reason = _too_much(size, growth, cost, stop - time.perf_counter())
            if reason:
                if number == 0:
                    growth.left_out[size] = reason
                continue
            progress(f"{axis.name}: {size}, round {number + 1}")
            began = time.perf_counter()
            reading = _in_copy(axis, size)
            cost[size] = time.perf_counter() - began
            growth.readings.setdefault(size, []).append(reading)
    return growth


def _too_much(size: int, growth: Growth, cost: Mapping[int, float], seconds: float) -> str:
    """Return why a size is not run; empty: it is."""
    if size in cost:
        return "time" if cost[size] > seconds else ""
    if not cost:
        return ""  # the smallest is always run once
    if growth.left_out:
        return next(iter(growth.left_out.values()))
    *before, last = cost
    reading = growth.readings[last][0]
    rate = reading.seconds / last
    if before:  # what each process costs does not grow
        rate = max(rate, (cost[last] - cost[before[-1]]) / (last - before[-1]))
    if cost[last] + rate * (size - last) > seconds:
        return "time"
    free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return "memory" if reading.size * size / last > _MOST_MEMORY * free else ""


def _in_copy(axis: Axis, size: int) -> SizeCost:
    """Run a size in a copy of this process, so that memory begins anew.

    Raises:
        InputError: the process has ended without an answer.
    """
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(axis, size, theirs))
    process.start()
    theirs.close()
    try:
        return SizeCost(*ours.recv())
    except EOFError:
        process.join()
        raise InputError(
            f"{axis.name} {size}: its process ended with {process.exitcode}"
        ) from None
    finally:
        process.join()
        ours.close()


def _answer(axis: Axis, size: int, pipe: Any) -> None:
    before = _resident()
    seconds, written = axis.run(size)
    grown = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    pipe.send((seconds, grown if written is None else float(written)))


def _resident() -> float:
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return float(pages) * os.sysconf("SC_PAGE_SIZE")


def upper_half(sizes: Collection[int]) -> list[int]:
    """Return the sizes in the upper half of their decades, but two at least, if there are."""
    ordered = sorted(sizes)
    middle = math.sqrt(ordered[0] * ordered[-1]) if ordered else 0.0
    return [size for size in ordered if size >= middle or size in ordered[-2:]]


def slope(values: Mapping[int, Sequence[float]]) -> Slope | None:
    """Return the power with which values grow over the `upper_half` of sizes.

    None: fewer than two sizes, or three values above 0, are there. The interval takes readings as
    independent, scattered alike about a straight line of logarithms.

    Args:
        values: size → readings.
    """
    pairs = [
        (math.log(size), math.log(value))
        for size in upper_half(values)
        for value in values[size]
        if value > 0.0
    ]
    if len(pairs) < 3 or len({x for x, _ in pairs}) < 2:
        return None
    fit = stats.linregress(*zip(*pairs, strict=True))
    half = float(stats.t.ppf(0.975, len(pairs) - 2) * fit.stderr)
    return Slope(float(fit.slope), float(fit.slope) - half, float(fit.slope) + half)


def column(growth: Growth, name: str) -> dict[int, list[float]]:
    """Return size → `seconds` or `size` of all readings."""
    return {size: [getattr(r, name) for r in rows] for size, rows in growth.readings.items()}

"""How fast the propeller model is, beside the authors' algorithm done step by step.

    python propeller_speed.py [--points 1000000] [--no-cold]

One core: the process is bound to a single one. Times are processor times, what a core to oneself
takes; where something else runs on it, the clock shows more, and the ratio of the two is printed.
The slow version is plain Python with quadrature and general root finding, four passes as the
authors' program makes them
(`tombo_ws/src/tombo_dynamics/test/propeller/independent_propeller.py`); that it computes the same
is checked in the same run. A symbolic version, as theirs is, would be slower still; there is no
sympy here, so it is not measured.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"  # before numpy is imported
sys.path.insert(0, str(Path(__file__).parents[4] / "tombo_ws/src/tombo_dynamics/test/propeller"))

import independent_propeller as slow  # noqa: E402
import numpy as np  # noqa: E402

from tombo_dynamics.propeller import (  # noqa: E402
    LAWS,
    RPM,
    configuration,
    evaluate,
    parameter_row,
    speed_for_thrust,
    valid_speed,
)
from tombo_dynamics.propeller.laws.points import COLUMNS, solve_points  # noqa: E402

CONF = 13
REPEATS = 5
SHARES: list[float] = []
"""Processor time over time, of every run."""
FRESH = "from tombo_dynamics.propeller import RPM, evaluate; evaluate(13, 2000 * RPM)"


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def fastest(run: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the shortest processor time [s] of some runs."""
    best = np.inf
    for _ in range(repeats):
        start, used = time.perf_counter(), time.process_time()
        run()
        used = time.process_time() - used
        SHARES.append(used / (time.perf_counter() - start))
        best = min(best, used)
    return float(best)


def one_core() -> str:
    """Bind this process to one processor, where the system can do that."""
    if not hasattr(os, "sched_setaffinity"):
        return "threads: 1 (not bound to a core)"
    core = min(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return f"threads: 1, bound to one core of {os.cpu_count()}"


def compiled_point(law: str) -> float:
    """Return the time [s] of one call of the compiled solver for one point."""
    row = parameter_row(configuration(CONF), law)[None]
    which, speeds, out = np.zeros(1, dtype=np.int64), np.array([400.0]), np.empty((1, COLUMNS))
    number, calls = LAWS[law], 20_000

    def run() -> None:
        for _ in range(calls):
            solve_points(number, row, which, speeds, out)

    run()
    return fastest(run) / calls


def python_point(law: str) -> float:
    """Return the time [s] of one call of `evaluate` for one point, checks included."""
    chosen, calls = configuration(CONF), 5_000

    def run() -> None:
        for _ in range(calls):
            evaluate(chosen, 400.0, law)

    return fastest(run) / calls


def slow_point(law: str, speeds: list[float]) -> float:
    """Return the time [s] of a point step by step, the shortest of each."""
    total = 0.0
    for speed in speeds:
        total += fastest(lambda speed=speed: slow.solve(CONF, speed, law), 3)  # type: ignore[misc]
    return total / len(speeds)


def disagreement(law: str) -> float:
    """Return the largest relative difference of thrust, drag and angles to the slow version."""
    worst = 0.0
    for conf in (1, 5, 13):
        speeds = valid_speed(configuration(conf), law) * np.array([0.1, 0.3, 0.5, 0.7])
        points = evaluate(configuration(conf), speeds, law)
        for i, speed in enumerate(speeds):
            for name, value in slow.solve(conf, float(speed), law).items():
                mine = float(getattr(points, name)[i])
                worst = max(worst, abs(mine - value) / max(abs(value), 1e-6))
    return worst


def fresh_process(cache: str | None = None) -> float:
    """Return the duration [s] of a new Python that imports the library and evaluates a point."""
    environment = dict(os.environ, **({"TOMBO_CACHE_DIR": cache} if cache else {}))
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", FRESH], check=True, env=environment)
    return time.perf_counter() - start


def main() -> None:
    """Measure and write."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--points", type=int, default=1_000_000, help="of the vectorised runs")
    options.add_argument("--no-cold", action="store_true", help="leave the compilation out")
    given = options.parse_args()
    if given.points < 1:
        options.error("--points from 1")
    say(one_core())
    rng, count = np.random.default_rng(0), given.points
    say(f"\nConf. {CONF}; the shortest of {REPEATS} runs")
    say(f"{'':38}" + "".join(f"{law:>14}" for law in LAWS))

    def line(what: str, values: list[str]) -> None:
        say(f"{what:38}" + "".join(f"{value:>14}" for value in values))

    single = [compiled_point(law) for law in LAWS]
    line("one point, compiled", [f"{1e6 * t:.2f} us" for t in single])
    line(
        "one point, evaluate with its checks",
        [f"{1e6 * python_point(law):.1f} us" for law in LAWS],
    )
    speeds = rng.uniform(0.0, 900.0, count)
    length, density = rng.uniform(8.0, 16.0, count), rng.uniform(1.0, 1.3, count)
    jobs: list[tuple[str, Callable[[str], Any]]] = [
        (f"{count} speeds", lambda law: evaluate(CONF, speeds, law, outside="mask")),
        (
            f"{count} propellers",
            lambda law: evaluate(
                CONF, speeds, law, outside="mask", length_mm=length, air_density_kg_m3=density
            ),
        ),
    ]
    for what, job in jobs:
        took = [fastest(lambda law=law, job=job: job(law), 3) for law in LAWS]  # type: ignore[misc]
        line(what, [f"{t:.2f} s" for t in took])
    thrusts = rng.uniform(0.0, 9.0, count)
    took = [fastest(lambda law=law: speed_for_thrust(CONF, thrusts, law), 1) for law in LAWS]  # type: ignore[misc]
    line(f"{count} speeds for thrusts", [f"{t:.2f} s" for t in took])
    say(f"processor time over time: {min(SHARES):.2f} to {max(SHARES):.2f}, so one thread")

    say("\nThe same step by step in plain Python (quadrature, general root finding)")
    sample = [float(rpm) * RPM for rpm in (1000, 2000, 4000, 6000, 8000)]
    steps = [slow_point(law, sample) for law in LAWS]
    line("one point", [f"{1e3 * t:.1f} ms" for t in steps])
    line(
        "ratio to one compiled point", [f"{s / t:.0f}" for s, t in zip(steps, single, strict=True)]
    )
    line("largest relative difference", [f"{disagreement(law):.1e}" for law in LAWS])
    say("a symbolic version, as the authors' is: not measured, sympy is not installed")

    say("\nA new process: Python, import, first point")
    fresh_process()
    say(f"machine code in the cache            {min(fresh_process() for _ in range(3)):.2f} s")
    if not given.no_cold:
        with tempfile.TemporaryDirectory() as cache:
            say(f"everything compiled                  {fresh_process(cache):.1f} s")


if __name__ == "__main__":
    main()
